"""Feed a tracker event by event, and predict the position to the moment at which it is used."""

import argparse
import sys
from pathlib import Path

import numpy as np

import groundstation

BUNDLED = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"
# from mid-exposure to the autopilot: exposure, transfer, detection and radio
DELAY_S = 0.12


def main() -> None:
    """Track one and a half seconds; print each estimate and where the aircraft is by then."""
    np.set_printoptions(suppress=True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--session", type=Path, default=BUNDLED)
    session = parser.parse_args().session

    tracker = groundstation.Tracker(session / "rig.toml", span_m=2.3)
    # a camera, a serial port or a network would be in place of the recorded session
    for event in groundstation.session_events(session, from_s=20.0, to_s=21.5):
        report = tracker.step(event)
        for line in report.events:
            print(f"{line.t_s:7.2f} s  {line.text}")
        for estimate in report.estimates:
            ahead = tracker.estimate_at(estimate.t_s + DELAY_S)
            if estimate.kinematics is None or ahead is None:
                continue
            here, there = estimate.kinematics.position_runway_m, ahead.position_runway_m
            sigma = ahead.covariance[:3, :3].diagonal() ** 0.5
            print(f"{estimate.t_s:7.2f} s  {here.round(2)} m, in {DELAY_S:g} s {there.round(2)} ± {sigma.round(2)} m")


if __name__ == "__main__":
    try:
        main()
    except groundstation.InputError as fault:
        sys.exit(f"groundstation: {fault}")
