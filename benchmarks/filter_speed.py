"""The compiled filter against filterpy's classes: processor time of its steps and of a flight, and their difference.

    python benchmarks/filter_speed.py [--rounds N]

A simulated landing of two turning stations, labelled pixels at 10 Hz and PTU readings at 50 Hz, goes through the
pipeline with both, in turn. Times are this thread's processor time, medians over the rounds; kernels are compiled
before.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.estimation.config import EstimationConfig, FilterImplementation  # noqa: E402
from groundstation.estimation.filterpy_smoother import rts_step  # noqa: E402
from groundstation.estimation.parameters import ParameterPrior  # noqa: E402
from groundstation.estimation.smoother_history import SmoothAcross, Transition, smooth_across  # noqa: E402
from groundstation.estimation.station_ekf import StationEkf  # noqa: E402
from groundstation.messages import Event, InitialState, Kinematics  # noqa: E402
from groundstation.tracking.config import Config  # noqa: E402
from groundstation.tracking.pipeline import Pipeline  # noqa: E402
from tests.stereo_rig import aim, flight_events, glide, make_rig  # noqa: E402

DURATION_S = 6.0
CALLS = 40
PRIOR = ParameterPrior.independent(("left.runway_from_base.z", "right.ptu_clock.offset"), (1e-3, 0.01)).with_span(0.15)
START = InitialState(
    t_s=0.0,
    position_runway_m=glide(0.0) + np.array([0.5, -2.0, 0.3]),
    velocity_runway_m_s=np.array([0.5, -24.0, -1.0]),
    sigma_position_m=np.full(3, 3.0),
    sigma_velocity_m_s=np.full(3, 2.0),
)
SMOOTHERS: dict[FilterImplementation, SmoothAcross] = {
    FilterImplementation.COMPILED: smooth_across,
    FilterImplementation.FILTERPY: rts_step,
}


def fly(kind: FilterImplementation, events: list[Event]) -> tuple[float, list[Kinematics]]:
    """Return the processor time of a flight through the pipeline, s, and its estimates."""
    base = Config()
    own = replace(base.estimation, implementation=kind, labelled_sigma_px=0.5, fix_window_s=0.03)
    pipeline = Pipeline(make_rig(), replace(base, estimation=own), span_m=2.3, initial=START)
    found: list[Kinematics] = []
    began = time.thread_time()
    for event in events:
        found += [e.kinematics for e in pipeline.step(event).estimates if e.kinematics is not None]
    found += [e.kinematics for e in pipeline.finish().estimates if e.kinematics is not None]
    return time.thread_time() - began, found


def apart(a: list[Kinematics], b: list[Kinematics]) -> tuple[float, float]:
    """Return the largest difference of two runs: of means in their sigmas, of covariances over σ_i σ_j."""
    mean, spread = 0.0, 0.0
    for p, q in zip(a, b, strict=True):
        sigma = np.sqrt(np.diag(q.covariance))
        off = np.concatenate([p.position_runway_m - q.position_runway_m, p.velocity_runway_m_s - q.velocity_runway_m_s])
        mean = max(mean, float(np.abs(off / sigma).max()))
        spread = max(spread, float(np.abs((p.covariance - q.covariance) / np.outer(sigma, sigma)).max()))
    return mean, spread


def started(kind: FilterImplementation) -> StationEkf:
    """Return a filter that tracks a target 300 m away."""
    rig, point = make_rig(), np.array([0.0, 300.0, 15.0])
    config = EstimationConfig(implementation=kind)
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config, PRIOR)
    ekf.predict_to(0.0)
    for s in rig.stations:
        ekf.set_angles(s.name, aim(s.geometry(), point), (0.0, 0.0), 1e-5)
    ekf.start_target(point, np.array([0.0, -20.0, -1.0]), np.diag([0.1, 1.0, 0.1, 0.5, 0.5, 0.5]) ** 2)
    ekf.predict_to(0.02)
    return ekf


def steps(kind: FilterImplementation) -> dict[str, Callable[[], object]]:
    """Return the steps to time, each from the same state."""
    ekf = started(kind)
    before, angles = ekf.snapshot(), ekf.angles("left")
    prediction = ekf.predict_pixel("left")
    if prediction is None or before.time_s is None:
        raise SystemExit("the target is behind the camera")
    pixel, here_s = prediction.pixel + np.array([0.5, -0.3]), before.time_s
    F, Q = ekf.motion_over(0.1, before.imm.weights)
    x, P = before.imm.mean, before.imm.covariance
    after = F @ P @ F.T + Q
    step = Transition(t_s=0.0, next_s=0.1, x=x, P=P, F=F, x_next=F @ x, P_next=after, weights=before.imm.weights)

    def from_before(call: Callable[[], object]) -> Callable[[], object]:
        def run() -> None:
            ekf.restore(before)
            call()

        return run

    return {
        f"prediction of {before.imm.weights.size} modes, {x.size} states": from_before(
            lambda: ekf.predict_to(here_s + 0.02)
        ),
        "PTU reading": from_before(lambda: ekf.update_encoder("left", angles, 3e-5, 0.001, 0.0)),
        "pixel, with mode probabilities": from_before(
            lambda: ekf.update_pixel("left", pixel, 0.5 * np.eye(2), 0.0, 0.4)
        ),
        "step of the smoother": lambda: SMOOTHERS[kind](step, F @ x, 0.5 * after),
    }


def cost_s(call: Callable[[], object]) -> float:
    """Return the processor time of one call, s."""
    began = time.thread_time()
    for _ in range(CALLS):
        call()
    return (time.thread_time() - began) / CALLS


def compare_steps(rounds: int) -> None:
    """Print the time of each step with both, in turn."""
    compiled, theirs = (steps(kind) for kind in FilterImplementation)
    for name in compiled:
        compiled[name](), theirs[name]()
        both = [(cost_s(compiled[name]), cost_s(theirs[name])) for _ in range(rounds)]
        own, other = (statistics.median(column) * 1e6 for column in zip(*both, strict=True))
        print(f"{name:<38}{own:>9.0f} µs{other:>9.0f} µs   filterpy / compiled {other / own:6.1f}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    compare_steps(rounds)
    events = list(flight_events(make_rig(), glide, np.random.default_rng(5), duration_s=DURATION_S))
    _, ours = fly(FilterImplementation.COMPILED, events)
    _, plain = fly(FilterImplementation.FILTERPY, events)
    times = [[fly(kind, events)[0] for kind in FilterImplementation] for _ in range(rounds)]
    own, other = (statistics.median(column) for column in zip(*times, strict=True))
    print(f"{'a flight of ' + format(DURATION_S, 'g') + ' s through the pipeline':<38}", end="")
    print(f"{own:>10.2f} s{other:>10.2f} s   filterpy / compiled {other / own:6.1f}")
    mean, spread = apart(ours, plain)
    print(f"{len(ours)} estimates differ by at most {mean:.1e} sigma, their covariances by {spread:.1e}")


if __name__ == "__main__":
    main()
