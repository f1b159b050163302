"""The reference positions of a recording in its replay: as recorded, or by the antenna and clock of the rig in use."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import ReferenceFix
from groundstation.replay.reference_prior import ReferencePrior, reference_prior
from groundstation.replay.replay_inputs import ReplayInputs, learning_fixes
from groundstation.replay.replay_request import ReplayRequest
from groundstation.sources.recorded_fixes import recorded_fixes, recorrected_fixes, recorrected_in_place
from groundstation.sources.recording_source import LEAD_S


def learns_as_recorded(request: ReplayRequest, inputs: ReplayInputs) -> bool:
    """Return whether the recorded reference fixes update the filter, as they did in the recorded run."""
    recorded = inputs.session.recorded
    return recorded is not None and recorded.header.learns_from_reference and request.learn_until_s is None


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningReferences:
    """The reference fixes of a replay, where they are not those of the source as it has them.

    Attributes
    ----------
    learns : whether reference fixes update the filter.
    in_place : corrects each where it occurs, in a recording of operation: its events are in order of arrival.
    by_time : all of them, to be merged by time: those of the DGPS log, or of another recording, whose events are in
        order of time, and a clock may move a fix by more than the filter goes back. Empty, all have moved out of the
        part asked for.
    """

    learns: bool
    in_place: Callable[[ReferenceFix], ReferenceFix] | None = None
    by_time: list[ReferenceFix] | None = None

    @property
    def given(self) -> bool:
        """Whether there are any."""
        return self.in_place is not None or self.by_time is not None


def learning_references(request: ReplayRequest, inputs: ReplayInputs) -> LearningReferences:
    """Return the fixes that update the filter: of the DGPS log by ``learn_until_s``, else the recorded ones."""
    fixes = learning_fixes(request, inputs)
    return LearningReferences(learns=True, by_time=fixes) if fixes else references_by_rig(request, inputs)


def references_by_rig(request: ReplayRequest, inputs: ReplayInputs) -> LearningReferences:
    """Return the recorded reference fixes by antenna and clock of the rig in use, where they differ."""
    session, now = inputs.session, inputs.prior
    if session.recorded is None or not learns_as_recorded(request, inputs):
        return LearningReferences(learns=False)
    run = replace(session, rig=session.recorded.rig, recorded=replace(session.recorded, rig_replaced=False))
    before = reference_prior(run, inputs.config.estimation)
    moved_m, later_s = _antenna_m(now) - _antenna_m(before), now.offset_s - before.offset_s
    if later_s == 0.0 and not np.any(moved_m):
        return LearningReferences(learns=True)
    recorded = recorded_fixes(session.recorded)
    if session.in_operation:
        return LearningReferences(learns=True, in_place=recorrected_in_place(recorded, moved_m, later_s))
    first = -np.inf if request.from_s is None else request.from_s - LEAD_S
    last = np.inf if request.to_s is None else request.to_s + LEAD_S
    fixes = recorrected_fixes(recorded, moved_m, later_s)
    return LearningReferences(learns=True, by_time=[fix for fix in fixes if first <= fix.t_s <= last])


def _antenna_m(prior: ReferencePrior) -> FloatArray:
    """Return the antenna (3,) m from the nose; one that is not known is taken for the nose."""
    return np.zeros(3) if prior.antenna_in_body_m is None else prior.antenna_in_body_m
