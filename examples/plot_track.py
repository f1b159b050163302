"""Draw a track with its two-sigma bands: across the runway and above it, over the distance."""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

import groundstation

mpl.use("Agg")
import matplotlib.pyplot as plt

BUNDLED = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"


def main() -> None:
    """Replay four seconds and write a picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--session", type=Path, default=BUNDLED)
    parser.add_argument("--out", type=Path, default=Path("track.png"), help="the picture to write")
    options = parser.parse_args()

    run = groundstation.replay_session(options.session, from_s=20.0, to_s=24.0)
    seen = run.tracking
    distance = run.position_m[seen, 1]
    figure, plots = plt.subplots(2, 1, sharex=True, layout="constrained")
    for plot, axis, name in zip(plots, (0, 2), ("across the runway, m", "above the runway, m"), strict=True):
        value = run.position_m[seen, axis]
        band = 2.0 * run.covariance_m2[seen, axis, axis] ** 0.5
        plot.fill_between(distance, value - band, value + band, alpha=0.3, label="two sigma")
        plot.plot(distance, value, label="filter")
        plot.plot(distance, run.triangulated_m[seen, axis], ".", markersize=3, label="triangulation")
        plot.set_ylabel(name)
    plots[0].legend()
    plots[1].set_xlabel("distance, m")
    # the aircraft flies from left to right
    plots[1].invert_xaxis()
    figure.savefig(options.out)
    print(f"wrote {options.out}: {seen.sum()} pairs from {distance.max():.0f} to {distance.min():.0f} m")


if __name__ == "__main__":
    try:
        main()
    except groundstation.InputError as fault:
        sys.exit(f"groundstation: {fault}")
