"""A night's pictures as sightings of landmarks of known direction, for `calibrate check`: one for each picture.

The stars of a picture share the error of its angles, so that they are one sighting: of the star nearest to the
picture's middle, at the pixel that all of them together put it at.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.landmarks.sighting_table import COLUMNS
from calibration.mount.problem import EARTH_RATE_RAD_S, lift_by_refraction
from calibration.stars.identified_stars import (
    IdentifiedPicture,
    SkyUncertainty,
    by_solver,
    by_station,
    expected_pixels,
)
from calibration.stars.night import StarPicture
from calibration.stars.sky import ObservingSite, SkyOverSite, decimal_year
from calibration.stars.star_solver import StarSolver
from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.rig.rig import Rig, Station

# of what a lens that has changed a little does to a picture's middle
_LEAST_SIGMA_PX = 0.05
# a head that has turned no farther shows its stars where the rig expects them
_NEAR_PX = 30.0
_LANDMARK_COLUMNS = ("landmark", "kind", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class NightTables:
    """The two tables, and the pictures that gave nothing, each with the reason."""

    sightings: Path
    landmarks: Path
    without: tuple[str, ...]


def write_night_tables(
    folder: Path,
    rig: Rig,
    pictures: Mapping[str, Sequence[StarPicture]],
    site: ObservingSite,
    uncertain: SkyUncertainty,
) -> NightTables:
    """Write stars-sightings.csv and stars-landmarks.csv into a folder.

    Raises `InputError` where no picture's stars are recognised, or a file cannot be written.
    """
    sky, without = SkyOverSite(site), []
    times = [picture.utc_s for own in pictures.values() for picture in own]
    seen: list[list[str]] = []
    marks: list[list[str]] = []
    for name, own in pictures.items():
        solver = StarSolver(rig[name].lens, decimal_year(times))
        found = []
        for picture in own:
            one = _identified(picture, rig[name], solver, sky)
            if isinstance(one, str):
                without.append(f"{picture.label}: {one}")
            else:
                found.append(one)
        for one in found:
            towards, row = _sighting(one, rig[name])
            seen.append(row)
            marks.append([row[1], "direction", *_numbers(towards), *_numbers(_sigma(towards, uncertain, len(found)))])
    if not seen:
        raise InputError("stars", got="no picture whose stars are recognised", wanted="a clear night's")
    tables = NightTables(
        sightings=folder / "stars-sightings.csv", landmarks=folder / "stars-landmarks.csv", without=tuple(without)
    )
    _write(tables.sightings, COLUMNS, seen)
    _write(tables.landmarks, _LANDMARK_COLUMNS, marks)
    return tables


def _identified(
    picture: StarPicture, station: Station, solver: StarSolver, sky: SkyOverSite
) -> IdentifiedPicture | str:
    """Return a picture's stars: by the solver, which needs no orientation, or where the rig expects them."""
    solved = solver.solve(picture.seen)
    if not isinstance(solved, str):
        return by_solver(picture, solved, sky)
    return by_station(picture, station, solver, sky, _NEAR_PX, None) or solved


def _sighting(one: IdentifiedPicture, station: Station) -> tuple[FloatArray, list[str]]:
    """Return the direction (3,) of a picture's middle star and its row of the table of sightings."""
    picture = one.picture
    pan, tilt = picture.reading_rad.tolist()
    angles = station.ptu_axes.angles(pan, tilt, float(picture.sense[0]), float(picture.sense[1]))
    expected, _ = expected_pixels(station, angles, one.towards)
    seen, sigma = picture.seen.pixel_px[one.image], picture.seen.sigma_px[one.image]
    off = seen - expected
    shift = np.median(off, axis=0)
    middle = int(np.argmin(np.linalg.norm(expected - 0.5 * np.array(station.lens.image_size_px), axis=1)))
    scatter = max(1.4826 * float(np.median(np.abs(off - shift))), float(np.median(sigma)))
    pixel = expected[middle] + shift
    degrees = np.degrees(picture.reading_rad)
    senses = ["" if s == 0.0 else f"{s:g}" for s in picture.sense]
    row = [
        *(picture.station, f"stars of {picture.label}", f"{degrees[0]:.6f}", f"{degrees[1]:.6f}"),
        *(f"{pixel[0]:.3f}", f"{pixel[1]:.3f}", f"{max(scatter / np.sqrt(len(off)), _LEAST_SIGMA_PX):.4f}"),
        *(f"{picture.utc_s:.3f}", *senses),
    ]
    return one.towards[middle], row


def _sigma(towards: FloatArray, uncertain: SkyUncertainty, count: int) -> FloatArray:
    """Return one sigma (3,) of a direction, so large that the mean of ``count`` has that of clock and refraction.

    These are common to all directions; the check takes landmarks' errors as independent.
    """
    clock = EARTH_RATE_RAD_S * uncertain.clock_s
    lifted = uncertain.refraction * float(np.linalg.norm(lift_by_refraction(towards[None])))
    return np.sqrt(count) * np.array([clock, clock, np.hypot(clock, lifted)])


def _numbers(vector: FloatArray) -> list[str]:
    return [f"{value:.9g}" for value in vector.tolist()]


def _write(path: Path, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    try:
        write_whole(path, text.getvalue())
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a folder that can be written") from fault
