"""The aircraft's own GNSS position against the track: false calls, and how soon faults are called.

usage: python benchmarks/gnss_watch_study.py [--approaches N] [--chance P] [--workers N]

Each approach is a landing drawn from the stated prior and tracked from pixels through the whole pipeline
(benchmarks/landing_flights). Receivers, fixed beforehand: `rtk`, white noise of 15 mm and 20 mm that last for a minute
per axis; `plain`, 0.3 m and 1.5 m that last for 150 s; both at 10 positions a second, late by a constant drawn from 0
to 0.3 s, their antenna off by a draw of 0.1 m per axis. Faults begin when the aircraft is 300 m from the stations.
"""

import argparse
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from landing_flights.tracked_approach import TrackedApproach, prior_landing, track
from parallel_study import StudyRun, add_study_arguments, in_blocks
from scipy.stats import beta

from groundstation.arrays import FloatArray
from groundstation.cli.number_arguments import count
from groundstation.integrity.gnss_watch import GnssWatch
from groundstation.integrity.own_position import OwnPosition

RATE_HZ = 10.0
FAULT_AT_M = 300.0
_DELAY_S = (0.0, 0.3)
_ANTENNA_M = 0.1
_BLOCK = 10
_ENOUGH_S = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Receiver:
    """One sigma per axis of white noise and of an error that lasts, m; for so long, s."""

    white_m: float
    lasting_m: float
    lasting_s: float

    @property
    def sigma_m(self) -> float:
        """What it states of itself."""
        return math.hypot(self.white_m, self.lasting_m)


RECEIVERS = {
    "rtk": Receiver(white_m=0.015, lasting_m=0.02, lasting_s=60.0),
    "plain": Receiver(white_m=0.3, lasting_m=1.5, lasting_s=150.0),
}
# a step to the side, m; a drift to the side, m/s; nothing new
FAULTS: dict[str, dict[str, tuple[str, float]]] = {
    "rtk": {"step 3 m": ("step", 3.0), "drift 0.5 m/s": ("drift", 0.5), "frozen": ("frozen", 0.0)},
    "plain": {"step 12 m": ("step", 12.0), "drift 2 m/s": ("drift", 2.0), "frozen": ("frozen", 0.0)},
}


def told_positions(receiver: Receiver, approach: TrackedApproach, t_s: FloatArray, seed: int) -> FloatArray:
    """Return positions (n, 3) of a receiver without a fault at times (n,) of their arrival."""
    generator = np.random.default_rng([seed, 304])
    delay_s = generator.uniform(*_DELAY_S)
    told = approach.landing.trajectory.position(t_s - delay_s) + _ANTENNA_M * generator.normal(size=3)
    kept = math.exp(-1.0 / (RATE_HZ * receiver.lasting_s))
    lasting = generator.normal(size=told.shape)
    for k in range(1, t_s.size):
        lasting[k] = kept * lasting[k - 1] + math.sqrt(1.0 - kept**2) * lasting[k]
    return np.asarray(told + receiver.lasting_m * lasting + receiver.white_m * generator.normal(size=told.shape))


def with_fault(told_m: FloatArray, t_s: FloatArray, from_s: float, fault: tuple[str, float], side: float) -> FloatArray:
    """Return the positions with a fault from a time on, to one side."""
    kind, size = fault
    after = t_s >= from_s
    broken = told_m.copy()
    if kind == "frozen":
        broken[after] = told_m[np.flatnonzero(~after)[-1]]
    else:
        broken[:, 0] += side * size * (after if kind == "step" else np.maximum(t_s - from_s, 0.0))
    return broken


def called_s(
    approach: TrackedApproach, receiver: Receiver, t_s: FloatArray, told_m: FloatArray, chance: float
) -> float | None:
    """Return when the first call comes; None without one. Estimates and positions come as they would in operation."""
    watch = GnssWatch(false_call_chance=chance)
    estimates = iter(approach.estimates())
    newest = next(estimates, None)
    sigma = np.full(3, receiver.sigma_m)
    for at_s, told in zip(t_s.tolist(), told_m, strict=True):
        while newest is not None and newest[0] <= at_s:
            watch.add_estimate(*newest)
            newest = next(estimates, None)
        if watch.take(OwnPosition(t_s=at_s, position_runway_m=told, sigma_m=sigma)).verdict.called:
            return float(at_s)
    return None


def watched(job: tuple[list[int], float]) -> list[dict[str, Any]]:
    """Return, for each approach, when calls come without a fault (s, or None), and delays of those with one."""
    seeds, chance = job
    found = []
    for seed in seeds:
        approach = track(prior_landing(seed), seed)
        times = [t for t, _ in approach.estimates()]
        # positions come between the pairs
        t_s = np.arange(times[0] + 1.0, times[-1], 1.0 / RATE_HZ) + 0.037
        y = approach.landing.trajectory.position(t_s)[:, 1]
        from_s = float(t_s[int(np.argmax(y < FAULT_AT_M))])
        side = 1.0 if seed % 2 else -1.0
        row: dict[str, Any] = {"false": {}, "delay_s": {}}
        for name, receiver in RECEIVERS.items():
            told = told_positions(receiver, approach, t_s, seed)
            row["false"][name] = called_s(approach, receiver, t_s, told, chance)
            for label, fault in FAULTS[name].items():
                reach = t_s < from_s + (_ENOUGH_S if fault[0] != "drift" else 12.0)
                broken = with_fault(told, t_s, from_s, fault, side)[reach]
                at_s = called_s(approach, receiver, t_s[reach], broken, chance)
                row["delay_s"][f"{name}, {label}"] = None if at_s is None else at_s - from_s
        found.append(row)
    return found


def main() -> None:
    """Print false calls and delays."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--approaches", type=count, default=1000, metavar="N", help="default: 1000")
    parser.add_argument(
        "--chance", type=float, default=5e-4, metavar="P", help="stated, of a false call (default: 5e-4)"
    )
    add_study_arguments(parser, "gnss watch")
    options = parser.parse_args()
    jobs = {str(block[0]): (block, options.chance) for block in in_blocks(range(options.approaches), _BLOCK)}
    values = StudyRun.chosen("gnss watch", options).values(watched, jobs)
    rows = [row for block in values.values() for row in block]
    for name in RECEIVERS:
        calls = sum(row["false"][name] is not None for row in rows)
        most = beta.ppf(0.95, calls + 1, len(rows) - calls)
        print(f"{name}: {calls} false calls in {len(rows)} approaches (95 %: below {1000.0 * most:.1f} in 1000)")
    for label in rows[0]["delay_s"]:
        delays = [row["delay_s"][label] for row in rows]
        called = np.array([d for d in delays if d is not None and d >= 0.0])
        missed, within = sum(d is None for d in delays), int(np.sum(called <= 1.0 + 1e-9))
        longest = f"median {np.median(called):.2f} s, longest {called.max():.2f} s" if called.size else "none"
        print(f"{label}: {within} of {len(rows)} within 1 s, {missed} not called; {longest}")


if __name__ == "__main__":
    main()
