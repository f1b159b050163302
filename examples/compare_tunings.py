"""Replay one recording with two tunings and compare the tracks."""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

import groundstation

BUNDLED = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"
# `groundstation config` prints every key with its meaning, unit and bounds
TUNINGS = {
    "default": "",
    "classic detector": '[detection]\ndetector = "classic"\n',
}


def main() -> None:
    """Replay two seconds with each tuning; print how much was tracked and how well it says it knows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--session", type=Path, default=BUNDLED)
    session = parser.parse_args().session

    tracks = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in TUNINGS.items():
            config = Path(folder) / "config.toml"
            config.write_text(text)
            run = groundstation.replay_session(session, config=config, from_s=20.0, to_s=22.0)
            sigma = np.sqrt(np.einsum("nii->ni", run.covariance_m2[run.tracking]))
            print(
                f"{name}: {run.tracking.sum()} of {len(run.t_s)} pairs tracked, median sigma "
                f"{np.median(sigma, axis=0).round(3)} m"
            )
            tracks[name] = run
    first, second = tracks.values()
    both = first.tracking & second.tracking
    apart = np.linalg.norm(first.position_m[both] - second.position_m[both], axis=1)
    print(f"apart in {both.sum()} pairs: median {np.median(apart):.2f} m, most {apart.max():.2f} m")


if __name__ == "__main__":
    try:
        main()
    except groundstation.InputError as fault:
        sys.exit(f"groundstation: {fault}")
