"""Pose of an aircraft's camera from a runway's corners, and the inertial filter that it aids; docs/onboard-pose.md.

usage: [GROUNDSTATION_DATA=…] python benchmarks/onboard_pose.py [--runs N] [--seed N] [--only corners,attitude,start,
horizon,noise,extract,flight] [--figures DIR]
Prints one JSON line for each study; DIR gets the paper's figures as PNG.
"""

import argparse
import json
import os
from pathlib import Path

from onboard_pose_study.dataset import attitude_study, corner_study, start_study
from onboard_pose_study.flight import flight_study
from onboard_pose_study.simulated import extraction_study, horizon_study, noise_study

KINDS = ("corners", "attitude", "start", "horizon", "noise", "extract", "flight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=60, help="flights of the filter study")
    parser.add_argument("--seed", type=int, default=11, help="of the flights")
    parser.add_argument("--only", default=",".join(KINDS))
    parser.add_argument("--figures", type=Path)
    options = parser.parse_args()
    data = Path(os.environ.get("GROUNDSTATION_DATA", Path(__file__).parents[2] / "shared" / "data")) / "runway-corners"
    if options.figures is not None:
        options.figures.mkdir(parents=True, exist_ok=True)
    wanted = options.only.split(",")
    on_data = {"corners": corner_study, "attitude": attitude_study, "start": start_study}
    for kind in wanted:
        if kind in on_data:
            if not data.is_dir():
                print(json.dumps({kind: f"skipped: no {data}"}))
                continue
            result = on_data[kind](data)
        elif kind == "horizon":
            result = horizon_study()
        elif kind == "noise":
            result = noise_study()
        elif kind == "extract":
            result = extraction_study()
        else:
            result = flight_study(options.runs, options.figures, options.seed)
        print(json.dumps({kind: result}), flush=True)


if __name__ == "__main__":
    main()
