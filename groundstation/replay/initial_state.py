"""The state that the filter of a replay starts from."""

from collections.abc import Sequence

import numpy as np

from groundstation.errors import SessionError
from groundstation.messages import DgpsFix, InitialState
from groundstation.replay.reference_prior import ReferencePrior
from groundstation.replay.replay_inputs import ReplayInputs
from groundstation.replay.replay_request import ReplayRequest
from groundstation.sources.reference_fixes import reference_fixes
from groundstation.tracking.config import TrackStart

# standard deviation of an unknown DGPS clock offset, for the initial position of a start from DGPS
_DGPS_CLOCK_SIGMA_S = 0.5
_DGPS_START_SPAN_S = 1.0


def initial_state(request: ReplayRequest, inputs: ReplayInputs, first_s: float) -> InitialState | None:
    """Return the recorded initial state; with another tuning or start time, the one that the tuning selects."""
    session = inputs.session
    if session.recorded is not None and request.config is None and request.from_s is None:
        return session.recorded.header.initial
    return _start(inputs.config.start, inputs, first_s)


def _start(kind: TrackStart, inputs: ReplayInputs, first_s: float) -> InitialState | None:
    """Return the initial state, or None to start with a search."""
    session = inputs.session
    if kind is TrackStart.SEARCH or (kind is TrackStart.AUTO and session.initial is None):
        return None
    if kind in (TrackStart.AUTO, TrackStart.INITIAL):
        if session.initial is None:
            raise SessionError(f"{session.name}: session.toml", got="no [initial]", wanted="one, for start = 'initial'")
        return session.initial
    return start_from_dgps(inputs.dgps, inputs.prior, first_s, session.name)


def start_from_dgps(dgps: Sequence[DgpsFix], prior: ReferencePrior, first_s: float, name: str) -> InitialState:
    """Return position and velocity from a line fit to the first second of DGPS positions in the range.

    They are those of the nose at session time, by ``prior`` of antenna and clock. What is unknown of the offset between
    the two clocks is included in sigma along the direction of flight.
    """
    fixes = reference_fixes(dgps, prior.antenna_in_body_m, np.inf, prior.offset_s)
    near = [f for f in fixes if first_s <= f.t_s <= first_s + _DGPS_START_SPAN_S]
    if len(near) < 2:
        raise SessionError(
            f"{name}: dgps.csv", got=f"{len(near)} fixes in the first second", wanted="2 or more, for start = 'dgps'"
        )
    clock_sigma_s = _DGPS_CLOCK_SIGMA_S if prior.offset_sigma_s is None else prior.offset_sigma_s
    t = np.array([f.t_s for f in near])
    points = np.array([f.position_runway_m for f in near])
    velocity, at_start = np.polyfit(t - t[0], points, 1)
    return InitialState(
        t_s=float(t[0]),
        position_runway_m=np.asarray(at_start, dtype=np.float64),
        velocity_runway_m_s=np.asarray(velocity, dtype=np.float64),
        sigma_position_m=1.0 + clock_sigma_s * np.abs(velocity),
        sigma_velocity_m_s=np.full(3, 2.0),
    )
