"""Heads calibrated by airliners of drawn days against the truth: relative pan, and whether its sigma is true.

    python benchmarks/sky_days.py [--days N] [--first N] [--passes N] [--workers N]

Each day (docs/calibration.md) has airliners that pass within 50 km, each followed by both heads with twelve stops of
three pictures, and what a receiver notes of them: positions with errors that last, steps of CPR and height, an own
latency of up to 0.4 s, the receiver's of up to 2 s. Printed are, over the days: rms of relative pan and tilt over the
angles of operation, the sigma stated, and eᵀC⁻¹e of all parameters with its bounds (chi-square, 99.9 %); and the same
of the relative direction by what the rig file states.
"""

import argparse
from multiprocessing import Pool
from typing import Any

import numpy as np
from scipy.stats import chi2

from calibration.combination.text_report import relative_direction
from calibration.sky.calibrate import calibrate_sky
from calibration.sky.simulated.day_draw import draw_day
from calibration.sky.simulated.day_score import score_day
from calibration.stars.identified_stars import SkyUncertainty
from calibration.stars.joint_night import common_sigma, relative_sigma


def one_day(job: tuple[int, int]) -> dict[str, Any]:
    """Calibrate one day and return its errors and sigmas."""
    seed, passes = job
    day = draw_day(seed, passes)
    uncertain = SkyUncertainty(clock_s=0.1, refraction=0.01)
    found = calibrate_sky(day.rig, day.pictures, day.reports, day.site, uncertain)
    score = score_day(found, day)
    written = relative_direction(found.night.rig, *day.true_rig.names)
    relative, common = relative_sigma(found.night.joint, 0, 1), common_sigma(found.night.joint)
    return {
        "relative": np.mean(score.relative_deg**2, axis=0),
        "common": np.mean(score.common_deg**2, axis=0),
        "relative_sigma": np.square([relative.pan_deg, relative.tilt_deg]),
        "common_sigma": np.square([common.pan_deg, common.tilt_deg]),
        "nees": score.nees,
        "written": None if written is None else np.square([written.pan_deg, written.tilt_deg]),
        "written_nees": score.written_nees,
        "degrees": score.degrees,
        "latency": (found.latency_s or 0.0) - day.latency_s,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--days", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--passes", type=int, default=5)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    jobs = [(seed, options.passes) for seed in range(options.first, options.first + options.days)]
    with Pool(options.workers) as pool:
        rows = list(pool.imap(one_day, jobs))
    print(f"{len(rows)} days of {options.passes} airliners")
    for what in ("relative", "common"):
        squares, sigma = (np.array([r[what + end] for r in rows]) for end in ("", "_sigma"))
        for k, axis in enumerate(("pan", "tilt")):
            rms, stated = np.sqrt(squares[:, k].mean()), np.sqrt(sigma[:, k].mean())
            ratio = np.mean(squares[:, k] / sigma[:, k])
            worst = np.sqrt(squares[:, k].max())
            text = f"{what} {axis}: rms {rms:.5f} deg, stated {stated:.5f}, worst {worst:.5f}"
            print(f"{text}, (error/sigma)² {ratio:.3f}")
    degrees, total = sum(r["degrees"] for r in rows), sum(r["nees"] for r in rows)
    low, high = chi2.ppf([0.0005, 0.9995], degrees) / degrees
    print(f"NEES of all parameters: {total / degrees:.3f} ({low:.3f} to {high:.3f} in 99.9 %)")
    pan, tilt = np.sqrt(np.mean([r["written"] for r in rows], axis=0))
    low, high = chi2.ppf([0.0005, 0.9995], 2 * len(rows)) / len(rows)
    print(f"rig files: relative pan stated {pan:.5f} deg, tilt {tilt:.5f}, e'C^-1e of the relative direction", end=" ")
    print(f"{np.mean([r['written_nees'] for r in rows]):.3f} of 2 ({low:.3f} to {high:.3f} in 99.9 %)")
    late = np.array([r["latency"] for r in rows])
    print(f"latency: {late.mean():.3f} s more than the receiver's, aircraft's own included, ± {late.std():.3f}")


if __name__ == "__main__":
    main()
