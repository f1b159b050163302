"""Estimates of a flight as a filter would have them, for the tests of this folder."""

from collections.abc import Iterator

import numpy as np

from groundstation.messages import Kinematics, StepReport, TrackEstimate, TrackStatus, TriangulationStatus
from groundstation.simulation.trajectory import Trajectory
from tests.landing.approaches import SIGMAS

# a filter's error changes in about so long
_LASTING_S = 0.3


def reports_of(
    trajectory: Trajectory, *, seed: int, rate_hz: float = 10.0, until_s: float | None = None
) -> Iterator[StepReport]:
    """Yield a report for each pair of a flight, its errors of `SIGMAS` lasting for some tenths of a second."""
    start, end = trajectory.span_s
    t = np.arange(start, end if until_s is None else min(until_s, end), 1.0 / rate_hz)
    truth = np.hstack([trajectory.position(t), trajectory.velocity(t)])
    generator = np.random.default_rng([seed, 31])
    kept = np.exp(-1.0 / (rate_hz * _LASTING_S))
    error = generator.normal(size=6) * SIGMAS
    for number, (t_s, state) in enumerate(zip(t, truth, strict=True)):
        error = kept * error + np.sqrt(1.0 - kept**2) * generator.normal(size=6) * SIGMAS
        there = state + error
        yield StepReport(estimates=(tracked(float(t_s), there[:3], there[3:], number),))


def tracked(
    t_s: float,
    position_m: np.ndarray,
    velocity_m_s: np.ndarray,
    number: int = 0,
    status: TrackStatus = TrackStatus.TRACKING,
) -> TrackEstimate:
    """Return the answer to one pair."""
    known = Kinematics(position_runway_m=position_m, velocity_runway_m_s=velocity_m_s, covariance=np.diag(SIGMAS**2))
    return TrackEstimate(
        t_s=t_s,
        epoch=number,
        status=status,
        kinematics=known,
        triangulation_status=TriangulationStatus.ONE_VIEW,
        triangulation=None,
    )
