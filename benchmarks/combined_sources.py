"""A drawn night of stars and a drawn day of airliners of the same heads, each alone and combined, against the truth.

    python benchmarks/combined_sources.py [--rigs N] [--first N] [--pointings N]

The heads are those of benchmarks/sky_days.py; a night of stars (--pointings pictures of each head) and five airliners
calibrate them independently, from workshops' rigs with errors of their own, and `calibrate combine` makes one rig of
both: nothing known before is shared, `--prior` is not tested. Printed are, over the rigs: rms of the errors of relative
pan and tilt over the angles of operation, what is stated, and the mean chi-square of agreement over its degrees of
freedom.
"""

import argparse

import numpy as np

from calibration.combination.fusion import combine
from calibration.combination.shared_prior import RigSource
from calibration.combination.text_report import relative_direction
from calibration.sky.calibrate import calibrate_sky
from calibration.sky.simulated.day_draw import draw_day
from calibration.stars.calibrate import calibrate_night, sky_uncertainty
from calibration.stars.identified_stars import SkyUncertainty
from calibration.stars.simulated.night_draw import NightErrors, draw_night
from calibration.stars.simulated.night_score import direction_errors_deg
from calibration.stars.simulated.observed_night import night_solver, observed_night
from groundstation.rig.rig import Rig


def relative_errors_deg(found: Rig, true: Rig) -> np.ndarray:
    """Return mean squares (2,) of the errors of relative pan and tilt."""
    first, second = (direction_errors_deg(found[s.name], s) for s in true.stations)
    return np.mean((first - second) ** 2, axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pointings", type=int, default=24)
    options = parser.parse_args()
    squares: dict[str, list[np.ndarray]] = {"stars": [], "airliners": [], "together": []}
    stated: dict[str, list[np.ndarray]] = {"stars": [], "airliners": [], "together": []}
    agreement = []
    for seed in range(options.first, options.first + options.rigs):
        day = draw_day(seed)
        sky = calibrate_sky(day.rig, day.pictures, day.reports, day.site, SkyUncertainty(clock_s=0.1, refraction=0.01))
        night = draw_night(seed, options.pointings, true_rig=day.true_rig)
        uncertain = sky_uncertainty(night.site, NightErrors().clock_s, each_clock=False)
        stars = calibrate_night(night.rig, observed_night(night, seed, night_solver(night)), night.site, uncertain)
        found = combine([RigSource(name="stars", rig=stars.rig), RigSource(name="airliners", rig=sky.night.rig)], 1.0)
        agreement.append(found.chi_square / found.degrees)
        for name, rig in (("stars", stars.rig), ("airliners", sky.night.rig), ("together", found.rig)):
            squares[name].append(relative_errors_deg(rig, day.true_rig))
            sigma = relative_direction(rig, "left", "right")
            if sigma is not None:
                stated[name].append(np.square([sigma.pan_deg, sigma.tilt_deg]))
        print(seed, *(f"{name} {np.sqrt(values[-1]).round(5)}" for name, values in squares.items()), flush=True)
    print(f"{options.rigs} rigs; chi-square of agreement over its degrees {np.mean(agreement):.2f}")
    for name, values in squares.items():
        pan, tilt = np.sqrt(np.mean(values, axis=0))
        said = np.sqrt(np.mean(stated[name], axis=0))
        print(f"{name}: relative pan {pan:.5f} deg (stated {said[0]:.5f}), tilt {tilt:.5f} ({said[1]:.5f})")


if __name__ == "__main__":
    main()
