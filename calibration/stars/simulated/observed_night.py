"""A drawn night as a calibration gets it: each picture with its reading, stamp and stars."""

import numpy as np

from calibration.stars.night import StarPicture
from calibration.stars.simulated.night_draw import DrawnNight
from calibration.stars.simulated.star_field import seen_stars, star_field
from calibration.stars.sky import SkyOverSite, decimal_year
from calibration.stars.star_solver import StarSolver


def night_solver(night: DrawnNight) -> StarSolver:
    """Return the catalogue and solver for a night's cameras, as they are known before."""
    times = [picture.utc_s for own in night.pictures.values() for picture in own]
    return StarSolver(night.rig.stations[0].lens, decimal_year(times))


def observed_night(night: DrawnNight, seed: int, solver: StarSolver) -> dict[str, tuple[StarPicture, ...]]:
    """Return the pictures of each station with the stars that a finder sees in them."""
    random, sky = np.random.default_rng([seed, 0x5EE]), SkyOverSite(night.site)
    found: dict[str, tuple[StarPicture, ...]] = {}
    for station in night.true_rig.stations:
        seen = []
        for number, picture in enumerate(night.pictures[station.name]):
            field = star_field(picture, station, solver, sky, night.clock_s, night.refraction, random)
            way = picture.pointing
            seen.append(
                StarPicture(
                    label=f"{station.name}-{number:03d}.png",
                    station=station.name,
                    reading_rad=picture.reading_rad,
                    sense=np.array([way.pan_from, way.tilt_from], dtype=np.float64),
                    utc_s=picture.utc_s,
                    seen=seen_stars(field, station, random),
                    readings=picture.readings,
                )
            )
        found[station.name] = tuple(seen)
    return found
