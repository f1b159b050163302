"""A drawn night as a folder: pictures with their table, the rig as it is known before, the site, and the truth."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from calibration.mount.problem import changed_sky
from calibration.picture_table import PICTURE_COLUMNS, READINGS_COLUMN, TIME_COLUMN
from calibration.stars.identified_stars import expected_pixels
from calibration.stars.simulated.night_draw import DrawnNight
from calibration.stars.simulated.observed_night import night_solver
from calibration.stars.simulated.star_field import star_field
from calibration.stars.simulated.star_renderer import hot_pixel_map, render_stars
from calibration.stars.site_file import site_to_toml
from calibration.stars.sky import SkyOverSite
from groundstation.files.whole_file import write_whole
from groundstation.rig.rig_toml import rig_to_toml

EXPOSURE_S = 0.5


def write_night(
    folder: Path, night: DrawnNight, seed: int, progress: Callable[[int, int], None] = lambda done, of: None
) -> None:
    """Write pictures.csv and the pictures, rig.toml, site.toml and truth.toml (the true rig) into a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    random, sky, solver = np.random.default_rng([seed, 0xF01D]), SkyOverSite(night.site), night_solver(night)
    rows = [",".join([*PICTURE_COLUMNS, TIME_COLUMN, READINGS_COLUMN, "pan_from", "tilt_from"])]
    total = sum(len(own) for own in night.pictures.values())
    for station in night.true_rig.stations:
        hot = hot_pixel_map(station.lens.image_size_px, random)
        for number, picture in enumerate(night.pictures[station.name]):
            progress(len(rows), total)
            field = star_field(picture, station, solver, sky, night.clock_s, night.refraction, random)
            name = f"{station.name}-{number:03d}.png"
            half = 0.5 * EXPOSURE_S
            pan, tilt = picture.angles_rad.tolist()
            axis = station.geometry().camera_pose(pan, tilt).runway_from_camera[:, 2]
            # the middle of the picture moves with the sky
            moved = np.concatenate([changed_sky(axis[None], sky.pole(), np.array([t, 0.0]))[0] for t in (-half, half)])
            ends, _ = expected_pixels(station, (pan, tilt), moved)
            image = render_stars(field, ends[1] - ends[0], hot, random)
            write_whole(folder / name, cv2.imencode(".png", image, (cv2.IMWRITE_PNG_COMPRESSION, 1))[1].tobytes())
            degrees = np.degrees(picture.reading_rad)
            way = picture.pointing
            rows.append(
                f"{name},{station.name},{degrees[0]:.5f},{degrees[1]:.5f},{picture.utc_s:.3f},"
                f"{picture.readings},"
                f"{way.pan_from},{way.tilt_from}"
            )
    write_whole(folder / "pictures.csv", "\n".join(rows) + "\n")
    write_whole(folder / "rig.toml", rig_to_toml(night.rig))
    write_whole(folder / "truth.toml", rig_to_toml(night.true_rig))
    write_whole(folder / "site.toml", site_to_toml(night.site))
