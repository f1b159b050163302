"""Replay a session to NumPy arrays: error against the truth, and its ratio to the stated covariance."""

import argparse
import sys
from pathlib import Path

import numpy as np

import groundstation

BUNDLED = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"


def main() -> None:
    """Replay four seconds and print RMSE and NEES."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--session", type=Path, default=BUNDLED, help="a session folder with truth.csv")
    session = parser.parse_args().session

    run = groundstation.replay_session(session, from_s=20.0, to_s=24.0)
    truth = np.genfromtxt(session / "truth.csv", delimiter=",", names=True)
    at = np.column_stack([np.interp(run.t_s, truth["t_s"], truth[f"{axis}_m"]) for axis in "xyz"])
    error = (run.position_m - at)[run.tracking]
    covariance = run.covariance_m2[run.tracking]
    # NEES over three is 1 in the mean where the covariance is true
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error) / 3.0

    print(f"{run.name}: {run.tracking.sum()} of {len(run.t_s)} pairs tracked")
    print("RMSE x, y, z:", np.sqrt((error**2).mean(axis=0)).round(3), "m")
    print("median sigma:", np.median(np.sqrt(np.einsum("nii->ni", covariance)), axis=0).round(3), "m")
    print(f"NEES / 3: {nees.mean():.2f}")


if __name__ == "__main__":
    try:
        main()
    except groundstation.InputError as fault:
        sys.exit(f"groundstation: {fault}")
