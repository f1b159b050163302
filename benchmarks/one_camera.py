"""Accuracy and consistency of a track while one camera alone sees the target for eight seconds.

    python benchmarks/one_camera.py [--seeds N]

Closed-loop simulation with rendered pictures of 320 × 240 px (`groundstation.simulation.closed_loop_rendered`): an
approach from 430 m at 20 m/s and 10 pairs/s; the left PTU loses power at 4 s and homes until 12 s. Printed for each
seed: error and sigma along the runway and the ANEES in the third, fifth and eighth second, and the ANEES of the whole.
"""

import argparse

import numpy as np
from live_serial_faults import small_rig

from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.closed_loop import ClosedLoopConfig, ClosedLoopFault, ClosedLoopFaultKind
from groundstation.simulation.closed_loop_rendered import RenderedClosedLoopSimulation
from groundstation.tracking.config import Config

FLIGHT = GlideApproach(start_y_m=430.0, end_y_m=130.0, speed_m_s=20.0, aim_y_m=60.0)
FROM_S, HOMING_S, SPAN_M = 4.0, 8.0, 2.3
MOMENTS_S = (2.0, 4.0, 7.0)


def main() -> None:
    """Print a line for each seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    kind = ClosedLoopFaultKind.PTU_POWER_CYCLED
    fault = ClosedLoopFault(kind=kind, station="left", from_s=FROM_S, to_s=FROM_S + HOMING_S)
    hardware = ClosedLoopConfig(frame_rate_hz=10.0, homing_s=HOMING_S)
    for seed in range(1, options.seeds + 1):
        day = RenderedClosedLoopSimulation(
            small_rig(), Config(), FLIGHT, faults=[fault], hardware=hardware, seed=seed, span_m=SPAN_M
        ).run()
        parts = []
        for moment_s in MOMENTS_S:
            begin_s = FROM_S + moment_s
            held = [
                (e.kinematics.position_runway_m[1] - truth[1], np.sqrt(e.kinematics.covariance[1, 1]))
                for e, truth in zip(day.estimates, day.truth_m, strict=True)
                if e.kinematics is not None and begin_s <= e.t_s < begin_s + 1.0
            ]
            anees = day.squared_errors(begin_s, begin_s + 1.0).mean() / 3.0
            parts.append(f"{held[-1][0]:+6.1f} ± {held[-1][1]:4.1f} m ({anees:5.2f})" if held else "no track")
        print(f"seed {seed}: " + ", ".join(parts) + f"; all {day.squared_errors(1.0).mean() / 3.0:.2f}", flush=True)


if __name__ == "__main__":
    main()
