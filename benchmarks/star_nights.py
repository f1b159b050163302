"""Heads calibrated by drawn nights against the truth and the Cramér-Rao bound of the fitted model.

    python benchmarks/star_nights.py [--nights N] [--first N] [--pointings N] [--workers N]

Each night (docs/calibration.md) has two heads of 0.00625° encoders with unknown mounts, axes and lenses, stars of the
catalogue with pixel noise, clouds, strangers. Printed are, over the nights: rms of the relative and common pan and tilt
over the angles of operation and the same over the sigma stated (the bound: the fit's own covariance is the inverse of
its information), NEES of all parameters, and how many pictures were solved wrongly: an attitude more than 1° off.
"""

import argparse
from multiprocessing import Pool
from typing import Any

import numpy as np

from calibration.stars.calibrate import calibrate_night, sky_uncertainty
from calibration.stars.joint_night import common_sigma, relative_sigma
from calibration.stars.simulated.night_draw import DrawnNight, NightErrors, draw_night
from calibration.stars.simulated.night_score import score_night
from calibration.stars.simulated.observed_night import night_solver, observed_night
from calibration.stars.sky import SkyOverSite

WRONG_DEG = 1.0


def one_night(job: tuple[int, int]) -> dict[str, Any]:
    """Calibrate one night and return its errors and sigmas."""
    seed, pointings = job
    night = draw_night(seed, pointings)
    solver = night_solver(night)
    pictures = observed_night(night, seed, solver)
    found = calibrate_night(
        night.rig, pictures, night.site, sky_uncertainty(night.site, NightErrors().clock_s, each_clock=False)
    )
    score = score_night(found, night)
    relative, common = relative_sigma(found.joint, 0, 1), common_sigma(found.joint)
    wrong, solved, total = _solves(night, pictures, solver)
    return {
        "seed": seed,
        "relative": np.mean(score.relative_deg**2, axis=0),
        "common": np.mean(score.common_deg**2, axis=0),
        "relative_sigma": np.square([relative.pan_deg, relative.tilt_deg]),
        "common_sigma": np.square([common.pan_deg, common.tilt_deg]),
        "nees": score.nees,
        "wrong": wrong,
        "solved": solved,
        "pictures": total,
        "used": sum(len(n.pictures) for n in found.joint.nights),
        "stars": float(np.mean([len(p.image) for n in found.joint.nights for p in n.pictures])),
        "parameters": len(found.joint.nights[0].fit.change),
    }


def _solves(night: DrawnNight, pictures: Any, solver: Any) -> tuple[int, int, int]:
    """Return how many pictures the solver alone got wrong, how many it solved, and of how many."""
    sky = SkyOverSite(night.site)
    wrong = solved = total = 0
    for name, own in pictures.items():
        geometry = night.true_rig[name].geometry()
        for seen, taken in zip(own, night.pictures[name], strict=True):
            total += 1
            found = solver.solve(seen.seen)
            if isinstance(found, str):
                continue
            solved += 1
            axis = geometry.camera_pose(*taken.angles_rad.tolist()).runway_from_camera[:, 2]
            by_solver = sky.icrs_from_runway(taken.utc_s).T @ found.camera_from_icrs[2]
            # refraction, aberration and an unknown principal point are a tenth of a degree each
            wrong += bool(np.degrees(np.arccos(min(1.0, float(axis @ by_solver)))) > WRONG_DEG)
    return wrong, solved, total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nights", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pointings", type=int, default=24)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    jobs = [(seed, options.pointings) for seed in range(options.first, options.first + options.nights)]
    with Pool(options.workers) as pool:
        rows = list(pool.imap(one_night, jobs))
    print(f"{len(rows)} nights, {options.pointings} pointings, {rows[0]['parameters']} parameters a head")
    total, solved, used, wrong = (sum(r[k] for r in rows) for k in ("pictures", "solved", "used", "wrong"))
    print(f"pictures {total}: solved {solved}, used {used}, solved wrongly {wrong}")
    print(f"stars a picture: {np.mean([r['stars'] for r in rows]):.0f}")
    for what in ("relative", "common"):
        squares = np.array([r[what] for r in rows])
        sigma = np.array([r[f"{what}_sigma"] for r in rows])
        for k, axis in enumerate(("pan", "tilt")):
            rms, stated = np.sqrt(squares[:, k].mean()), np.sqrt(sigma[:, k].mean())
            worst = np.sqrt(squares[:, k].max())
            print(f"{what} {axis}: rms {rms:.5f} deg, bound {stated:.5f}, ratio {rms / stated:.3f}, worst {worst:.5f}")
    nees = np.concatenate([r["nees"] for r in rows])
    print(f"NEES of all parameters: {nees.mean():.3f} ± {nees.std() / np.sqrt(len(nees)):.3f}")


if __name__ == "__main__":
    main()
