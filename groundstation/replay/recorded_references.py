"""The reference positions of a recording in its replay: as recorded, or by the antenna and clock of the rig in use."""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import ReferenceFix
from groundstation.replay.reference_prior import ReferencePrior, reference_prior
from groundstation.replay.replay_inputs import ReplayInputs
from groundstation.replay.replay_request import ReplayRequest
from groundstation.sources.recorded_fixes import recorded_fixes, recorrected_fixes
from groundstation.sources.recording_source import LEAD_S


def learns_as_recorded(request: ReplayRequest, inputs: ReplayInputs) -> bool:
    """Return whether the recorded reference fixes update the filter, as they did in the recorded run."""
    recorded = inputs.session.recorded
    return recorded is not None and recorded.header.learns_from_reference and request.learn_until_s is None


def fixes_by_other_rig(request: ReplayRequest, inputs: ReplayInputs) -> list[ReferenceFix]:
    """Return the recorded reference fixes by antenna and clock of the rig in use; none where they are as recorded."""
    session, now = inputs.session, inputs.prior
    if session.recorded is None or not learns_as_recorded(request, inputs):
        return []
    before = reference_prior(replace(session, rig=session.recorded.rig), inputs.config.estimation)
    moved_m = _antenna_m(now) - _antenna_m(before)
    if now.offset_s == before.offset_s and not np.any(moved_m):
        return []
    first = -np.inf if request.from_s is None else request.from_s - LEAD_S
    last = np.inf if request.to_s is None else request.to_s + LEAD_S
    fixes = recorrected_fixes(recorded_fixes(session.recorded), moved_m, now.offset_s - before.offset_s)
    return [fix for fix in fixes if first <= fix.t_s <= last]


def _antenna_m(prior: ReferencePrior) -> FloatArray:
    """Return the antenna (3,) m from the nose; one that is not known is taken for the nose."""
    return np.zeros(3) if prior.antenna_in_body_m is None else prior.antenna_in_body_m
