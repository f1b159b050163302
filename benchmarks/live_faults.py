"""A landing in operation under faults, alone and in pairs: continuity, recovery, and consistency of the track.

    python benchmarks/live_faults.py [--runs N] [--seed N] [--only WORD]

Virtual time, pixels in place of pictures (groundstation.simulation.closed_loop): 200 m of a landing at 20 m/s, the
faults of one or two devices at drawn times. Printed for each kind: how often the track existed two seconds
after the last fault, the share of lost epochs, and the ANEES of all estimates with a position.
"""

import argparse
import math
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.messages import TrackStatus
from groundstation.rig.rig import load_rig
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.closed_loop import (
    ClosedLoopConfig,
    ClosedLoopFault,
    ClosedLoopFaultKind,
    ClosedLoopSimulation,
)
from groundstation.tracking.config import Config

ROOT = Path(__file__).resolve().parent.parent
FLIGHT = GlideApproach(start_y_m=380.0, end_y_m=160.0, speed_m_s=20.0, aim_y_m=60.0)
SETTLED_S = 2.0
HARDWARE = ClosedLoopConfig(homing_s=3.0)
OF_THE_RECEIVER = (
    ClosedLoopFaultKind.DGPS_GONE,
    ClosedLoopFaultKind.DGPS_FROZEN,
    ClosedLoopFaultKind.DGPS_CLOCK_STEPPED,
)
OF_NO_STATION = (ClosedLoopFaultKind.PROCESS_KILLED, *OF_THE_RECEIVER)
# a receiver's clock steps by so much, forward or back, and every third time for good
STEPS_S = (0.05, 0.3)


def drawn(random: np.random.Generator, kind: ClosedLoopFaultKind) -> ClosedLoopFault:
    """Return a fault of a kind at a drawn time, of a drawn station."""
    begin = float(random.uniform(2.0, 5.0))
    length = float(random.uniform(0.2, 2.0))
    station = "" if kind in OF_NO_STATION else str(random.choice(["left", "right"]))
    if kind is ClosedLoopFaultKind.PTU_POWER_CYCLED:
        length = HARDWARE.homing_s
    return ClosedLoopFault(kind=kind, station=station, from_s=begin, to_s=begin + length)


def with_receiver(faults: list[ClosedLoopFault], seed: int) -> tuple[list[ClosedLoopFault], ClosedLoopConfig]:
    """Return the faults and the hardware: a receiver that fails has to be there before, and its clock steps somehow."""
    if not any(f.kind in OF_THE_RECEIVER for f in faults):
        return faults, HARDWARE
    # a separate random stream: the other days stay unchanged
    random = np.random.default_rng([seed, 2])
    step_s = float(random.uniform(*STEPS_S) * random.choice([-1.0, 1.0]))
    if random.random() < 1.0 / 3.0:
        faults = [replace(f, to_s=math.inf) if f.kind is ClosedLoopFaultKind.DGPS_CLOCK_STEPPED else f for f in faults]
    return faults, replace(HARDWARE, dgps_rate_hz=5.0, dgps_step_s=step_s)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="the first fault is of a kind with this word")
    options = parser.parse_args()
    rig, kinds = load_rig(ROOT / "recordings" / "landing-1" / "rig.toml"), list(ClosedLoopFaultKind)
    firsts = [kind for kind in kinds if options.only in kind.value]
    random = np.random.default_rng(options.seed)
    back: dict[str, list[bool]] = defaultdict(list)
    lost: dict[str, list[float]] = defaultdict(list)
    errors: dict[str, list[float]] = defaultdict(list)
    inside: dict[str, list[float]] = defaultdict(list)
    for number in range(options.runs):
        first, second = (of[int(random.integers(0, len(of)))] for of in (firsts, kinds))
        faults = [drawn(random, first)]
        if number % 2:
            faults.append(drawn(random, second))
        faults, hardware = with_receiver(faults, options.seed + number)
        result = ClosedLoopSimulation(
            rig, Config(), FLIGHT, faults=faults, hardware=hardware, seed=options.seed + number
        ).run()
        end_s = max(f.to_s if math.isfinite(f.to_s) else f.from_s for f in faults) + SETTLED_S
        for name in {f.kind.value for f in faults} | {"two at once" if number % 2 else "alone", "all"}:
            back[name].append(result.share(TrackStatus.TRACKING, end_s, end_s + 1.0) >= 0.9)
            lost[name].append(result.share(TrackStatus.LOST, 1.0, 11.0))
            errors[name].extend(result.squared_errors(1.0))
            inside[name].append(float(np.mean(result.inside)))
    print(f"{options.runs} runs, seed {options.seed}")
    print(f"{'fault':22s} {'runs':>5s} {'back':>8s} {'lost %':>7s} {'ANEES':>6s} {'>χ² 99.9 %':>10s} {'central %':>9s}")
    for name in sorted(back):
        squares = np.array(errors[name])
        print(
            f"{name:22s} {len(back[name]):5d} {sum(back[name]):4d}/{len(back[name])} {100 * np.mean(lost[name]):7.2f} "
            f"{squares.mean() / 3:6.2f} {100 * np.mean(squares > 16.27):10.3f} {100 * np.mean(inside[name]):9.2f}"
        )


if __name__ == "__main__":
    main()
