"""Initial state of a target in the filter: propagated to the filter time, corrected for the errors of the rig."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.imm import ImmFilter
from groundstation.estimation.linearisation import PixelLinearisation
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import LOG_SPAN, ParameterPrior
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.state_model import StateLayout


class TargetStarter:
    """Sets the target states to the initial state of a track.

    Parameters
    ----------
    layout, prior : of the filter.
    linearisation : of the pixel models, for a state that was triangulated with the rig file.
    motion : motion model of manoeuvres.
    """

    def __init__(
        self, layout: StateLayout, prior: ParameterPrior, linearisation: PixelLinearisation, motion: MotionModel
    ) -> None:
        self._layout, self._prior = layout, prior
        self._linearisation, self._motion = linearisation, motion

    def start(self, imm: ImmFilter, track: ProvisionalTrack, age_s: float, clock_age_s: float) -> None:
        """Set the target to the initial state of a track, ``age_s`` before the filter time.

        ``clock_age_s`` is the time over which clocks have drifted.
        """
        target = self._layout.target
        F = self._motion.transition(age_s)[target, target]
        covariance = F @ track.covariance @ F.T + self._motion.process_noise(age_s)[target, target]
        mean = F @ track.mean
        imm.set_states(target, mean, covariance)
        for part in self._layout.offsets.values():
            imm.set_states(part, np.zeros(2), np.eye(2))
        span = self._layout.parameters.get(LOG_SPAN)
        if span is not None:
            # reset to the prior, since another aircraft may have another span
            own = self._prior.names.index(LOG_SPAN)
            variance = self._prior.covariance[own : own + 1, own : own + 1]
            imm.set_states(slice(span, span + 1), np.zeros(1), variance)
        imm.reset_modes()
        if track.triangulated and self._layout.parameters:
            self._correlate_with_rig(imm, mean, covariance, clock_age_s)

    def _correlate_with_rig(self, imm: ImmFilter, mean: FloatArray, covariance: FloatArray, clock_age_s: float) -> None:
        """Correct an initial state (6,), triangulated with the rig file, for the estimated errors of the rig."""
        target, constant = self._layout.target, self._layout.constant
        sensitivity = None
        # the sensitivity depends on the position: the second iteration uses the corrected one
        for _ in range(2):
            sensitivity = self._linearisation.sensitivity(imm.x, clock_age_s)
            if sensitivity is None:
                return
            imm.set_states(target, mean + sensitivity @ imm.x[constant], covariance)
        if sensitivity is not None:
            imm.correlate(target, constant, sensitivity)
