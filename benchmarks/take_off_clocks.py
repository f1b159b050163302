"""Clocks found by `calibrate flight` on drawn take-offs, whose detected nose lies off the nose.

    python benchmarks/take_off_clocks.py [--flights N] [--first SEED] [--workers N]

A take-off towards the cameras from 204 m, 15 pairs/s, heads that wander by 0.7 deg about it, readings at 60 Hz, pixels
of 0.5 px; drawn are mounts (0.05 deg about each axis), clocks of cameras and PTUs (20 ms each), the log's clock
(0.1 s), and how far along the body the point lies that is seen (5 cm): a detector's nose is a little off, always to the
same side. Everything is free: `--free orientation,camera_clock,ptu_clock`, the log's clock besides. Clocks are told
against the left camera's, since what all have in common no flight shows. The bound is (JᵀWJ + prior)⁻¹ of the noise put
in, at the truth, and what the point's place adds, which no estimate without bias can take off. Figures in
docs/notes/position.md.
"""

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from calibration_rigs import bounding, without_noise
from drawn_rigs import draw, errors, waves
from parallel_study import StudyRun, add_study_arguments, as_json
from scipy.stats import chi2

from calibration.flight.calibrate import FlightCalibration, FlightRequest, calibrate_flight
from calibration.flight.covariance import moved_by_point
from calibration.flight.observations import FlightData, gather_flight
from calibration.flight.problem import DGPS_OFFSET
from groundstation.session import load_session
from groundstation.simulation import Scenario, case_b, simulate
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.pointing import DisturbedPointing
from groundstation.simulation.session_folder import write_session_folder
from groundstation.simulation.take_off import TakeOff, take_off

FREE = "orientation,camera_clock,ptu_clock"
POINT_M = 0.05
LOG_S = 0.1
CHANCE = 1e-3
_DRAWS = 78
_PLAN = TakeOff(start_y_m=204.0, stand_s=3.0, acceleration_m_s2=3.0, climb_speed_m_s=19.0)
# the heads look past the aircraft as a person's with a joystick: middle, amplitude (rad), period (s), share of it
_WANDER_RAD = ((0.0, 0.012, 3.1, 0.0), (0.0, 0.010, 2.3, 0.25), (0.0, 0.0, 1.0, 0.0))
_REFERENCE = "left.camera_clock.offset"
CLOCKS = ("right.camera_clock.offset", "left.ptu_clock.offset", "right.ptu_clock.offset", DGPS_OFFSET)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockErrors:
    """Errors (4,) of `CLOCKS` against the left camera, s, their claimed covariance (4, 4), and the two bounds (4,)."""

    error: np.ndarray
    covariance: np.ndarray
    bound: np.ndarray
    bound_of_nose: np.ndarray


@contextmanager
def _flown(scenario: Scenario, stated: Scenario) -> Iterator[tuple[FlightCalibration, FlightData]]:
    """Calibrate on a flight with unknown antenna position; return that flight and the same one without noise."""
    with tempfile.TemporaryDirectory() as folder:
        for name, flight in (("session", scenario), ("quiet", without_noise(scenario))):
            seen = replace(simulate(flight), scenario=replace(flight, dgps=stated.dgps))
            write_session_folder(Path(folder) / name, seen, name="simulated")
        request = FlightRequest(
            session=Path(folder) / "session", out=Path(folder) / "rig.toml", free=FREE, point_sigma_m=POINT_M
        )
        yield calibrate_flight(request), gather_flight(load_session(Path(folder) / "quiet"), None, None, None)


def one_flight(seed: int) -> ClockErrors:
    """Draw, fly, calibrate, compare."""
    generator = np.random.default_rng([_DRAWS, seed])
    plain = case_b(
        seed=seed,
        rate_hz=15.0,
        trajectory=take_off(_PLAN),
        pointing=DisturbedPointing(deviation=waves(_WANDER_RAD, 2.0)),
        ptu_hz=60.0,
    )
    drawn = replace(draw(plain.rig, "clocks", generator), late_s=LOG_S * float(generator.normal()))
    ahead_m = POINT_M * float(generator.normal())
    dgps = DgpsModel(clock_offset_s=drawn.late_s, antenna_in_body_m=np.array([-ahead_m, 0.0, 0.0]))
    scenario = replace(plain, rig=drawn.stated, true_rig=drawn.true, dgps=dgps)
    with _flown(scenario, replace(scenario, dgps=DgpsModel())) as (found, exact):
        fit = found.fit
        error = errors(fit, found.rig, drawn)
        truth = error + fit.change
        joint = bounding(fit, exact, truth)
        bound = np.linalg.inv(joint.fit_problem().linearise(truth).information)
        by_point = POINT_M * moved_by_point(joint, truth, bound)
    places = [fit.problem.names.index(name) for name in CLOCKS]
    against = np.zeros((len(CLOCKS), len(error)))
    against[np.arange(len(CLOCKS)), places] = 1.0
    # a log that is late is one whose times are too small: t_dgps = t_session + offset
    against[:, fit.problem.names.index(_REFERENCE)] = [-1.0, -1.0, -1.0, 1.0]
    whole = bound + np.outer(by_point, by_point)
    return ClockErrors(
        error=against @ error,
        covariance=against @ fit.covariance @ against.T,
        bound=np.sqrt(np.diag(against @ whole @ against.T)),
        bound_of_nose=np.sqrt(np.diag(against @ bound @ against.T)),
    )


def flight_as_json(seed: int) -> Any:
    """Return one flight's `ClockErrors` as JSON has them."""
    return as_json(one_flight(seed))


def main() -> None:
    """Print rms errors, claimed sigmas and bounds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    add_study_arguments(parser, "take-off-clocks")
    options = parser.parse_args()
    jobs = {f"flight-{seed}": seed for seed in range(options.first, options.first + options.flights)}
    found = StudyRun.chosen("take-offs", options).values(flight_as_json, jobs).values()
    flights = [ClockErrors(**{name: np.array(own) for name, own in value.items()}) for value in found]
    n = len(flights)
    error = np.array([f.error for f in flights])
    sigma = np.array([np.sqrt(np.diag(f.covariance)) for f in flights])
    low, high = chi2.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], n) / n
    print(f"{n} take-offs; mean square of error over sigma, {1 - CHANCE:.1%} of such: {low:.2f} to {high:.2f}")
    for k, name in enumerate(CLOCKS):
        rms = 1e3 * np.sqrt(np.mean(error[:, k] ** 2))
        claimed = 1e3 * np.sqrt(np.mean(sigma[:, k] ** 2))
        bound, exact = (
            1e3 * np.sqrt(np.mean([b[k] ** 2 for b in bounds]))
            for bounds in ([f.bound for f in flights], [f.bound_of_nose for f in flights])
        )
        square = np.mean((error[:, k] / sigma[:, k]) ** 2)
        print(
            f"  {name:<26} rms {rms:.2f}, sigma {claimed:.2f}, bound {bound:.2f} ms ({exact:.2f} of the nose itself); "
            f"rms/bound {rms / bound:.2f}; {square:.2f}"
        )
    together = np.mean([f.error @ np.linalg.solve(f.covariance, f.error) for f in flights])
    least, most = chi2.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], len(CLOCKS) * n) / n
    print(f"  all together {together:.2f} of {len(CLOCKS)}, {least:.2f} to {most:.2f}")


if __name__ == "__main__":
    main()
