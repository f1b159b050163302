"""Nose camera and inertial unit on airfields not used for tuning: error, stated sigma and consistency by light.

    python benchmarks/onboard_fly.py --draws 4 --first 951

Each draw is another airfield, place, wind, unit and light's noise, with the places of side lines and lamps drawn too;
minutes of rendering each.
"""

import argparse
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from parallel_study import StudyRun, add_study_arguments
from scipy.stats import chi2

from groundstation.arrays import ImageArray
from groundstation.experiments.onboard_flights import FollowedFlight, follow
from groundstation.onboard.scenes.nose_flight import NoseFlight, nose_flight, nose_setup
from groundstation.onboard.scenes.sequences import SEQUENCES, varied

LIGHTS = {"day": 0, "haze": 1, "dusk": 2, "night": 3}
# of one epoch: a stated covariance is exceeded so far by one of a thousand
_EXCEEDED = float(chi2.isf(1e-3, 6))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRow:
    """One flight's second half, from 190 m to 45 m: RMSE and stated sigma (m), NEES (6), shares of its epochs."""

    used: int
    refused: int
    pictures: int
    rmse_m: tuple[float, ...]
    sigma_m: tuple[float, ...]
    nees: float
    nees_first: float
    worst: float
    within_two_sigma: float
    beyond: float


def drawn_flight(light: str, seed: int, seconds: float = 13.0) -> NoseFlight:
    """Return a flight over another airfield in a light."""
    sequence = varied(SEQUENCES[LIGHTS[light]], seed, None, None)
    return nose_flight(sequence, nose_setup(sequence, seconds))


def measured(flight: NoseFlight, pictures: list[ImageArray]) -> FlightRow | None:
    """Return what came of a flight, None where the filter never started."""
    one = follow(flight, pictures)
    if len(one.t_s) == 0:
        return None
    return row_of(one, len(pictures))


def row_of(one: FollowedFlight, pictures: int) -> FlightRow:
    """Return the row of a flight that was followed."""
    half = len(one.t_s) // 2
    error, sigma, nees = one.error_m[half:], one.sigma_m[half:], one.nees[half:]
    used = sum(one.outcomes.get(name, 0) for name in ("started", "used", "restarted"))
    return FlightRow(
        used=used,
        refused=one.outcomes.get("gated", 0),
        pictures=pictures,
        rmse_m=tuple(np.sqrt((error**2).mean(axis=0)).tolist()),
        sigma_m=tuple(np.sqrt((sigma**2).mean(axis=0)).tolist()),
        nees=float(nees.mean()),
        nees_first=float(one.nees[:half].mean()),
        worst=float(one.nees.max()),
        within_two_sigma=float((np.abs(one.error_m) < 2.0 * one.sigma_m).mean()),
        beyond=float((one.nees > _EXCEEDED).mean()),
    )


def printed(light: str, seed: int, row: FlightRow | None) -> str:
    """Return a line of the table."""
    if row is None:
        return f"{light:6s} {seed:5d}  never started"
    rmse, sigma = ("/".join(f"{v:.2f}" for v in values) for values in (row.rmse_m, row.sigma_m))
    return (
        f"{light:6s} {seed:5d}  used {row.used:3d}/{row.pictures}  refused {row.refused:2d}  RMSE {rmse:16s} "
        f"sigma {sigma:16s} NEES {row.nees_first:5.1f} {row.nees:5.1f} worst {row.worst:6.1f}  "
        f"within 2 sigma {row.within_two_sigma:.2f}  beyond chi2 99.9 % {row.beyond:.3f}"
    )


def flown(job: tuple[str, int]) -> dict[str, Any] | None:
    """Render and follow a flight of a light and a seed; return its row's fields."""
    light, seed = job
    flight = drawn_flight(light, seed)
    row = measured(flight, [picture for _, picture in flight.pictures()])
    return None if row is None else asdict(row)


def main() -> None:
    """Render, follow and print, light by light."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=4, help="airfields in each light (default 4)")
    parser.add_argument("--first", type=int, default=951, help="seed of the first (default 951)")
    parser.add_argument("--lights", nargs="+", choices=LIGHTS, default=list(LIGHTS), help="default all four")
    add_study_arguments(parser, "onboard-fly")
    options = parser.parse_args()
    jobs = {
        f"{light}-{seed}": (light, seed)
        for light in options.lights
        for seed in range(options.first, options.first + options.draws)
    }
    found = StudyRun.chosen("onboard flights", options).values(flown, jobs)
    for name, (light, seed) in jobs.items():
        row = found[name]
        print(printed(light, seed, None if row is None else FlightRow(**row)))


if __name__ == "__main__":
    main()
