"""Error at the moment of use where the answers to pairs come 30 to 200 ms late, each by another time, known by stamps.

usage: python benchmarks/latency_at_use.py [--flights N] [--wind M_S] [--mount DEG] [--workers N]

Landings in gusts, 30 pairs a second through the shipped filter. Fifty times a second its position is asked for: of the
zero-delay filter, which has all pairs up to then, and of one that has those whose answers have come, in their order.
Errors are of the last fifteen seconds before the touchdown.
"""

import argparse
import math
from typing import Any

import numpy as np
from landing_flights.tracked_approach import Landing, gusty_landing, watched
from parallel_study import StudyRun, add_study_arguments, in_blocks

from groundstation.arrays import FloatArray
from groundstation.cli.number_arguments import count
from groundstation.simulation.flights import FlightModelKind

_BLOCK = 5
_PERIOD_S, _USED_EVERY_S = 1.0 / 30.0, 0.02
_LATENCY_S = (0.03, 0.2)
_COUNTED_S = 15.0
_KINDS = ("zero", "late")


def used(job: tuple[list[int], float, float]) -> list[dict[str, Any]]:
    """Return the sums of squared errors of each landing, (3,), zero-delay and late, and their numbers."""
    seeds, wind_m_s, mount_deg = job
    found = []
    for seed in seeds:
        errors = _errors(gusty_landing(seed, wind_m_s, FlightModelKind.WAVES), seed, math.radians(mount_deg))
        found.append({kind: {"squares": (of**2).sum(axis=0).tolist(), "count": len(of)} for kind, of in errors.items()})
    return found


def _errors(landing: Landing, seed: int, mount_rad: float) -> dict[str, FloatArray]:
    pipeline, events = watched(landing, seed, 1.0 / _PERIOD_S, mount_rad)
    until_s = landing.touchdown_s
    asked = np.arange(until_s - _COUNTED_S, until_s, _USED_EVERY_S)
    generator = np.random.default_rng([seed, 331])
    came_s, latency_s = -np.inf, generator.uniform(*_LATENCY_S)
    off: dict[str, list[FloatArray]] = {kind: [] for kind in _KINDS}
    for event in events:
        for estimate in pipeline.step(event).estimates:
            # it is the newest that is known until the next pair, or until the answer to that has come
            came_s = max(came_s, estimate.t_s + latency_s)
            latency_s = generator.uniform(*_LATENCY_S)
            next_s = estimate.t_s + _PERIOD_S
            newest = {"zero": (estimate.t_s, next_s), "late": (came_s, max(came_s, next_s + latency_s))}
            for kind, (from_s, to_s) in newest.items():
                for t_s in asked[(asked >= from_s) & (asked < to_s)]:
                    known = pipeline.estimate_at(float(t_s))
                    if known is not None:
                        off[kind].append(known.position_runway_m - landing.trajectory.position(np.array([t_s]))[0])
    return {kind: np.array(of).reshape(-1, 3) for kind, of in off.items()}


def main() -> None:
    """Print the errors and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=count, default=40, metavar="N", help="landings (default: 40)")
    parser.add_argument("--wind", type=float, default=6.0, metavar="M_S", help="whose gusts (default: 6)")
    parser.add_argument(
        "--mount",
        type=float,
        default=0.01,
        metavar="DEG",
        help="what pan and tilt are off by, one sigma (default: 0.01)",
    )
    add_study_arguments(parser, "latency-at-use")
    options = parser.parse_args()
    jobs = {f"{b[0]}": (b, options.wind, options.mount) for b in in_blocks(range(options.flights), _BLOCK)}
    flights = [
        flight for block in StudyRun.chosen("latency-at-use", options).values(used, jobs).values() for flight in block
    ]
    rms = {
        kind: np.sqrt(sum(np.array(f[kind]["squares"]) for f in flights) / sum(f[kind]["count"] for f in flights))
        for kind in _KINDS
    }
    for kind, values in rms.items():
        print(f"{kind}: rms error across, along, up {values[0]:.3f} {values[1]:.3f} {values[2]:.3f} m")
    ratio = rms["late"] / rms["zero"]
    all_axes = np.linalg.norm(rms["late"]) / np.linalg.norm(rms["zero"])
    print(f"late over zero-delay: {ratio[0]:.2f} {ratio[1]:.2f} {ratio[2]:.2f}, all axes {all_axes:.2f}")


if __name__ == "__main__":
    main()
