"""The filter with a journal of its operations, for replay, and a history of its transitions, for smoothing."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.ekf import INITIAL_RATE_SIGMA_RAD_S, StationEkf
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.smoother_history import Cut, SmootherHistory, Transition, smooth_across, smooth_within
from groundstation.estimation.state import EkfState
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation, Kinematics

# rounding of the mean stamp of an epoch against the stamps of its frames
ROUNDING_S = 1e-9


@dataclass(slots=True, eq=False)
class RecordedState(EkfState):
    """Snapshot of the filter, with the lengths of its history (``mark``) and journal."""

    mark: int
    journal_length: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelStep:
    """A pixel measurement (2,), accepted or not."""

    station: str
    pixel: FloatArray
    covariance_px2: FloatArray
    row_dt_s: float
    correlated_share: float

    def apply(self, ekf: StationEkf) -> None:
        """Apply it again, with the gate evaluated at the new state."""
        ekf.update_pixel(self.station, self.pixel, self.covariance_px2, self.row_dt_s, self.correlated_share)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WidthStep:
    """A measured silhouette width, accepted or not."""

    station: str
    width_px: float
    span_m: float
    alone: bool

    def apply(self, ekf: StationEkf) -> None:
        """Apply it again, with the gate evaluated at the new state."""
        ekf.update_width(self.station, self.width_px, self.span_m, alone=self.alone)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissStep:
    """A missed detection."""

    station: str
    detection_probability: float

    def apply(self, ekf: StationEkf) -> None:
        """Apply the missed detection again."""
        ekf.update_miss(self.station, self.detection_probability)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceStep:
    """A reference position (3,), accepted or not."""

    position_m: FloatArray
    covariance_m2: FloatArray
    ahead_s: float
    may_replace: bool

    def apply(self, ekf: StationEkf) -> None:
        """Apply it again, with the gate evaluated at the new state."""
        ekf.update_reference(self.position_m, self.covariance_m2, self.ahead_s, may_replace=self.may_replace)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StartStep:
    """The start of a target."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    covariance: FloatArray
    age_s: float
    triangulated: bool

    def apply(self, ekf: StationEkf) -> None:
        """Start it again."""
        start = (self.position_m, self.velocity_m_s, self.covariance, self.age_s)
        ekf.start_target(*start, triangulated=self.triangulated)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DropStep:
    """The end of a target."""

    def apply(self, ekf: StationEkf) -> None:
        """Drop the target again."""
        ekf.drop_target()


FilterStep = PixelStep | WidthStep | MissStep | ReferenceStep | StartStep | DropStep


def _replaced(innovation: Innovation) -> bool:
    """Return whether a measurement re-initialised the target: part of its degrees of freedom define the position."""
    return innovation.dof < innovation.residual.size


class RecordedEkf(StationEkf):
    """`StationEkf` that records its operations in ``journal`` and its transitions in ``history``.

    Encoder readings are recorded by `LateMeasurementBuffer`, since their outlier test is repeated during a replay.
    The history only covers times with a target.
    """

    def __init__(
        self,
        stations: Mapping[str, StationGeometry],
        turning: tuple[str, ...],
        config: EstimationConfig,
        prior: ParameterPrior | None = None,
    ) -> None:
        super().__init__(stations, turning, config, prior)
        self.history = SmootherHistory()
        self.journal: list[object] = []

    def snapshot(self) -> RecordedState:
        """Return the complete state of the filter."""
        return RecordedState(*self._state_fields(), self.history.mark, len(self.journal))

    def restore(self, saved: EkfState) -> None:
        """Restore a `snapshot`; records made since then are removed."""
        super().restore(saved)
        if isinstance(saved, RecordedState):
            self.history.truncate(saved.mark)
            del self.journal[saved.journal_length :]

    # ---------------------------------------------------------------------------------- recording
    def _propagate(self, from_s: float, to_s: float) -> FloatArray:
        """Predict the state to a later time, as `StationEkf` does, and record the transition."""
        x, P = self.state, self.covariance
        F = super()._propagate(from_s, to_s)
        self._record_transition(from_s, x, P, F)
        return F

    def update_encoder(
        self, station: str, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> Innovation:
        """Fuse one reading, as `StationEkf` does; the inflation by a rejected one is recorded as a transition."""
        x, P = self.state, self.covariance
        innovation = super().update_encoder(station, angles_rad, sigma_rad, clock_sigma_s, ahead_s)
        if not innovation.accepted:
            self._record_transition(self.time_s, x, P, np.eye(self.layout.size))
        return innovation

    def set_angles(
        self,
        station: str,
        angles_rad: tuple[float, float],
        rates_rad_s: tuple[float, float],
        sigma_rad: float,
        rate_sigma_rad_s: float = INITIAL_RATE_SIGMA_RAD_S,
    ) -> None:
        """Reset the states of one PTU from readings, as `StationEkf` does."""
        x, P = self.state, self.covariance
        super().set_angles(station, angles_rad, rates_rad_s, sigma_rad, rate_sigma_rad_s)
        F = np.eye(self.layout.size)
        for part in (self.layout.angles[station], self.layout.rates[station]):
            F[part, part] = 0.0
        self._record_transition(self.time_s, x, P, F)

    def start_target(
        self,
        position_m: FloatArray,
        velocity_m_s: FloatArray,
        covariance: FloatArray,
        age_s: float = 0.0,
        *,
        triangulated: bool = False,
    ) -> None:
        """Start a target, as `StationEkf` does; the history of a previous one ends here."""
        step = StartStep(
            position_m=position_m,
            velocity_m_s=velocity_m_s,
            covariance=covariance,
            age_s=age_s,
            triangulated=triangulated,
        )
        self.journal.append(step)
        self._record_end()
        super().start_target(position_m, velocity_m_s, covariance, age_s, triangulated=triangulated)

    def _restart_provisional(self, start: ProvisionalTrack) -> None:
        """Restart a provisional track, as `StationEkf` does; a replay of the journal repeats it."""
        self._record_end()
        super()._restart_provisional(start)

    def drop_target(self) -> None:
        """Drop the target, as `StationEkf` does; its history ends here."""
        self.journal.append(DropStep())
        self._record_end()
        super().drop_target()

    def update_pixel(
        self,
        station: str,
        pixel: FloatArray,
        covariance_px2: FloatArray,
        row_dt_s: float = 0.0,
        correlated_share: float = 0.0,
    ) -> Innovation | None:
        """Fuse the pixel of one camera, as `StationEkf` does; a re-initialisation is recorded as a reset."""
        step = PixelStep(
            station=station,
            pixel=pixel,
            covariance_px2=covariance_px2,
            row_dt_s=row_dt_s,
            correlated_share=correlated_share,
        )
        self.journal.append(step)
        x, P = self.state, self.covariance
        innovation = super().update_pixel(station, pixel, covariance_px2, row_dt_s, correlated_share)
        if innovation is not None and _replaced(innovation):
            self._record_replacement(x, P)
        return innovation

    def update_width(self, station: str, width_px: float, span_m: float, *, alone: bool) -> Innovation | None:
        """Fuse a silhouette's width, as `StationEkf` does."""
        self.journal.append(WidthStep(station=station, width_px=width_px, span_m=span_m, alone=alone))
        return super().update_width(station, width_px, span_m, alone=alone)

    def update_miss(self, station: str, detection_probability: float) -> None:
        """Update with a missed detection, as `StationEkf` does."""
        self.journal.append(MissStep(station=station, detection_probability=detection_probability))
        super().update_miss(station, detection_probability)

    def update_reference(
        self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float = 0.0, *, may_replace: bool = True
    ) -> Innovation:
        """Fuse a reference position, as `StationEkf` does; a replacement of the position is recorded as a reset."""
        step = ReferenceStep(
            position_m=position_m, covariance_m2=covariance_m2, ahead_s=ahead_s, may_replace=may_replace
        )
        self.journal.append(step)
        x, P = self.state, self.covariance
        innovation = super().update_reference(position_m, covariance_m2, ahead_s, may_replace=may_replace)
        if _replaced(innovation):
            self._record_replacement(x, P)
        return innovation

    def _reopen_reference_clock(self) -> None:
        """Inflate the error of the reference clock, as `StationEkf` does; a replay of the journal repeats it."""
        x, P = self.state, self.covariance
        super()._reopen_reference_clock()
        self._record_transition(self.time_s, x, P, np.eye(self.layout.size))

    def _inflate_span(self, width_px: float) -> None:
        """Inflate the error of the span, as `StationEkf` does; a replay of the journal repeats it."""
        x, P = self.state, self.covariance
        super()._inflate_span(width_px)
        if self.covariance is not P:
            self._record_transition(self.time_s, x, P, np.eye(self.layout.size))

    # ---------------------------------------------------------------------------------- queries
    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity (runway frame) and (6, 6) covariance at ``t_s``, given all measurements so far.

        Ahead of the filter time by the motion model and its process noise. Behind it by smoothing along the history,
        with the newer measurements and no added noise; beyond the history by the motion model backwards, with its
        process noise.
        """
        at = self.smoothed_at(t_s)
        return super().kinematics_at(t_s) if at is None else at

    def smoothed_at(self, t_s: float) -> Kinematics | None:
        """Return the smoothed target at a time behind the filter; None ahead of it and beyond the history."""
        if self.time_s is None or not self.has_target or t_s >= self.time_s - ROUNDING_S:
            return None
        x, P = self.state, self.covariance
        for record in reversed(self.history):
            if isinstance(record, Cut):
                return None
            if record.t_s <= t_s < record.next_s:
                return self.kinematics_of(*smooth_within(record, t_s, x, P, self.motion_over))
            x, P = smooth_across(record, x, P)
        return None

    def close_history(self) -> None:
        """End the history and release all its records."""
        self._record_end()
        self.history.release(self.history.mark)

    def _record_end(self) -> None:
        if self.has_target and self.time_s is not None:
            self.history.append(Cut(t_s=self.time_s, x=self.state, P=self.covariance))

    def _record_replacement(self, x: FloatArray, P: FloatArray) -> None:
        """Record a reset of all target states."""
        F = np.eye(self.layout.size)
        F[self.layout.target, self.layout.target] = 0.0
        self._record_transition(self.time_s, x, P, F)

    def _record_transition(self, from_s: float | None, x: FloatArray, P: FloatArray, F: FloatArray) -> None:
        """Record the transition from ``x``, ``P`` to the current state."""
        if not self.has_target:
            return
        start_s = -math.inf if from_s is None else from_s
        now_s = start_s if self.time_s is None else self.time_s
        self.history.append(
            Transition(
                t_s=start_s,
                next_s=now_s,
                x=x,
                P=P,
                F=F,
                x_next=self.state,
                P_next=self.covariance,
                weights=self._imm.weights,
            )
        )
