"""Which states an update estimates, and which it only considers (Schmidt 1966), by `CalibrationUse`."""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from groundstation.estimation.config import CalibrationUse, EstimationConfig
from groundstation.estimation.kalman_kernels import BoolArray
from groundstation.estimation.parameters import LOG_SPAN, time_places
from groundstation.estimation.state_model import StateLayout
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.messages import CarriedError

# number of stations from which the consistency of the rays makes the rig errors observable
_RAYS_THAT_CHECK = 3
# the rig counts as estimated once the sigma of each mount is below this share of the prior's
_OPEN_SHARE = 0.5


class ConsiderPolicy:
    """Decides for each state whether an update changes it.

    Parameters
    ----------
    layout, config : of the filter.
    stations : names of all stations; ``keeps_pixel_times`` if they are enough for their rays to check each other.
    """

    def __init__(self, layout: StateLayout, config: EstimationConfig, stations: Collection[str]) -> None:
        self._use, self._hold_s = config.calibration, config.reference_hold_s
        self._rig_is_uncertain = any(name.partition(".")[2] in CALIBRATION_PARAMETERS for name in layout.parameters)
        self.keeps_pixel_times = len(stations) >= _RAYS_THAT_CHECK
        every = np.ones(layout.size, np.bool_)
        self._moving = every.copy()
        self._moving[layout.constant] = False
        if LOG_SPAN in layout.parameters:
            self._moving[layout.parameters[LOG_SPAN]] = True
        # clock and shutter errors are not estimated here: encoder noise, which resembles motion, would bias them
        with_reference = every.copy()
        for name in stations:
            with_reference[time_places(layout.parameters, name)] = False
        # a fixed camera has one orientation: what its rig states of a second one is an error that lasts (lens, labels)
        for name in stations:
            for axis in "xyz" if name not in layout.angles else "":
                place = layout.parameters.get(f"{name}.head_from_camera.{axis}")
                if place is not None:
                    every[place] = with_reference[place] = False
        self.ever_estimated: BoolArray = {
            CalibrationUse.ESTIMATE: every,
            CalibrationUse.CONSIDER: self._moving,
            CalibrationUse.REFERENCE: with_reference,
        }[self._use]

    @property
    def learns_clocks(self) -> bool:
        """Whether the clock errors of the stations may be estimated."""
        return self._use is CalibrationUse.ESTIMATE

    def learns(self, now_s: float | None, newest_reference_s: float, newest_pixels_s: Mapping[str, float]) -> bool:
        """Return whether the carried errors are estimated at ``now_s``; otherwise they are consider parameters.

        ``newest_pixels_s`` is the time of the last accepted pixel of each station, for rigs of three and more.
        """
        if self._use is not CalibrationUse.REFERENCE:
            return self.learns_clocks
        oldest = (-math.inf if now_s is None else now_s) - self._hold_s
        if newest_reference_s >= oldest:
            return True
        known = newest_pixels_s.values()
        return len(known) >= _RAYS_THAT_CHECK and sum(t_s >= oldest for t_s in known) >= _RAYS_THAT_CHECK

    def rig_is_open(self, errors: Sequence[CarriedError]) -> bool:
        """Return whether references correct the rig and some mount is about as uncertain as in the rig file."""
        if self._use is not CalibrationUse.REFERENCE or not self._rig_is_uncertain:
            return False
        # a mount cannot be told from a misfit of the same camera, which is never estimated
        degenerate = {error.name.partition(".")[0] for error in errors if not self._may_be_estimated(error)}
        shares = [
            error.sigma / error.prior_sigma
            for error in errors
            if error.name.partition(".")[2].startswith(("runway_from_base", "head_from_camera"))
            and error.name.partition(".")[0] not in degenerate
        ]
        return not shares or max(shares) > _OPEN_SHARE

    @staticmethod
    def _may_be_estimated(error: CarriedError) -> bool:
        return error.estimated or not error.name.partition(".")[2].startswith("head_from_camera")

    def estimated(self, unobservable: list[int], *, learns: bool) -> BoolArray:
        """Return which states (n,) an update estimates, without those of the clocks that are ``unobservable``."""
        if not learns:
            return self._moving
        if not unobservable:
            return self.ever_estimated
        estimated = self.ever_estimated.copy()
        estimated[unobservable] = False
        return estimated
