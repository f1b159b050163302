"""The bundled landing, replayed with rigs that drawn nights of stars calibrated, against the rig that it was made with.

    python benchmarks/star_landing.py [--nights N] [--pointings N]

Positions, lever arms and encoders are the recording's; orientations are forgotten, and found with lens and axes by a
night's stars (seeded). The runway frame's azimuth and the baseline are taken as surveyed. Printed are RMSE of the track
against the recording's exact truth between y 100 and 250 m, of each night's rig and of the true rig, and their ratio.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from calibration.stars.calibrate import calibrate_night, sky_uncertainty, write_night_rig
from calibration.stars.joint_night import relative_sigma
from calibration.stars.simulated.night_draw import NightErrors, draw_night
from calibration.stars.simulated.night_score import score_night
from calibration.stars.simulated.observed_night import night_solver, observed_night
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.rig import load_rig

SESSION = Path(__file__).resolve().parent.parent / "recordings" / "landing-1"
FROM_M, TO_M = 100.0, 250.0


def rmse(rig: Path | None, out: Path) -> np.ndarray:
    """Return the RMSE (3,) of x, y, z, m, of a replay."""
    done = replay(ReplayRequest(session=SESSION, out=out, rig=rig, rerun=False, report=False))
    ranges = done.evaluation.summary["accuracy"]["truth"]["by_range"]
    inside = [r["common"] for r in ranges if r["from_m"] >= FROM_M and (r["to_m"] or np.inf) <= TO_M]
    squares = [r["epochs"] * np.square(r["ekf_rmse_m"]) for r in inside]
    return np.sqrt(np.sum(squares, axis=0) / sum(r["epochs"] for r in inside))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nights", type=int, default=5)
    parser.add_argument("--pointings", type=int, default=24)
    options = parser.parse_args()
    true = load_rig(SESSION / "rig.toml")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        base = rmse(None, folder / "true")
        print("true rig", np.round(base, 4))
        ratios = []
        for seed in range(options.nights):
            night = draw_night(seed, options.pointings, true_rig=true)
            found = calibrate_night(
                night.rig,
                observed_night(night, seed, night_solver(night)),
                night.site,
                sky_uncertainty(night.site, NightErrors().clock_s, each_clock=False),
            )
            rig = folder / f"{seed}.toml"
            write_night_rig(rig, found)
            error = rmse(rig, folder / str(seed))
            ratios.append(error / base)
            relative = np.sqrt(np.mean(score_night(found, night).relative_deg ** 2, axis=0))
            sigma = relative_sigma(found.joint, 0, 1)
            print(
                f"night {seed}: RMSE {np.round(error, 4)}, over the true rig's {np.round(ratios[-1], 3)}; relative pan"
                f" {relative[0]:.4f} deg (sigma {sigma.pan_deg:.4f}), tilt {relative[1]:.4f} ({sigma.tilt_deg:.4f})",
                flush=True,
            )
    print(
        f"ratio x, y, z: rms {np.round(np.sqrt(np.mean(np.square(ratios), axis=0)), 3)}, worst {np.max(ratios, axis=0)}"
    )


if __name__ == "__main__":
    main()
