"""The filter with a memory: what was done to it, to do it again, and what it went through, to go back along it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.ekf import StationEkf
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.smoother_history import Cut, SmootherHistory, Transition, back, back_into
from groundstation.estimation.state import EkfState
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation, Kinematics

# a pair's mean stamp differs from its frames' by rounding alone
ROUNDING_S = 1e-9


@dataclass(slots=True, eq=False)
class RecordedState(EkfState):
    """The filter at one instant, with how much it had recorded."""

    mark: int
    noted: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelStep:
    """A pixel (2,) that was handed to the filter, accepted or not."""

    station: str
    pixel: FloatArray
    covariance_px2: FloatArray
    row_dt_s: float
    correlated_share: float

    def apply(self, ekf: StationEkf) -> None:
        """Hand it in again; the gate judges anew."""
        ekf.update_pixel(self.station, self.pixel, self.covariance_px2, self.row_dt_s, self.correlated_share)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WidthStep:
    """A silhouette's width that was handed to the filter, accepted or not."""

    station: str
    width_px: float
    span_m: float
    alone: bool

    def apply(self, ekf: StationEkf) -> None:
        """Hand it in again; the gate judges anew."""
        ekf.update_width(self.station, self.width_px, self.span_m, alone=self.alone)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissStep:
    """A look that found nothing."""

    station: str
    detection_probability: float

    def apply(self, ekf: StationEkf) -> None:
        """Take it in again."""
        ekf.absorb_miss(self.station, self.detection_probability)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceStep:
    """A reference position (3,) that was handed to the filter, accepted or not."""

    position_m: FloatArray
    covariance_m2: FloatArray
    ahead_s: float
    may_replace: bool

    def apply(self, ekf: StationEkf) -> None:
        """Hand it in again; the gate judges anew."""
        ekf.update_reference(self.position_m, self.covariance_m2, self.ahead_s, may_replace=self.may_replace)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StartStep:
    """A target that was begun."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    covariance: FloatArray
    age_s: float
    triangulated: bool

    def apply(self, ekf: StationEkf) -> None:
        """Begin it again."""
        start = (self.position_m, self.velocity_m_s, self.covariance, self.age_s)
        ekf.start_target(*start, triangulated=self.triangulated)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DropStep:
    """The target was dropped."""

    def apply(self, ekf: StationEkf) -> None:
        """Drop it again."""
        ekf.drop_target()


FilterStep = PixelStep | WidthStep | MissStep | ReferenceStep | StartStep | DropStep


def _replaced(innovation: Innovation) -> bool:
    """Return whether a measurement has placed the target anew: some of its numbers went into the place."""
    return innovation.dof < innovation.residual.size


class RecordedEkf(StationEkf):
    """`StationEkf` that notes what is done to it in ``steps`` and what it goes through on its ``tape``.

    Readings of encoders are noted where they are judged (`LateMeasurementBuffer`), since the judgement is repeated.
    Only what happens while there is a target goes on the tape.
    """

    def __init__(
        self,
        stations: Mapping[str, StationGeometry],
        turning: tuple[str, ...],
        config: EstimationConfig,
        prior: ParameterPrior | None = None,
    ) -> None:
        super().__init__(stations, turning, config, prior)
        self.tape = SmootherHistory()
        self.steps: list[object] = []

    def snapshot(self) -> RecordedState:
        """Return all that the filter is now."""
        return RecordedState(*self._remembered(), self.tape.mark, len(self.steps))

    def restore(self, saved: EkfState) -> None:
        """Be again what the filter was at a `snapshot`; what was recorded since then is taken back."""
        super().restore(saved)
        if isinstance(saved, RecordedState):
            self.tape.truncate(saved.mark)
            del self.steps[saved.noted :]

    # ---------------------------------------------------------------------------------- what is noted
    def _carry(self, from_s: float, to_s: float) -> FloatArray:
        """Carry the state to a later time, as `StationEkf` does."""
        x, P = self.state, self.covariance
        F = super()._carry(from_s, to_s)
        self._went(from_s, x, P, F)
        return F

    def update_encoder(
        self, station: str, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> Innovation:
        """Fuse one reading, as `StationEkf` does; what a refused one adds to the variances is a step of its own."""
        x, P = self.state, self.covariance
        innovation = super().update_encoder(station, angles_rad, sigma_rad, clock_sigma_s, ahead_s)
        if not innovation.accepted:
            self._went(self.time_s, x, P, np.eye(self.layout.size))
        return innovation

    def set_angles(
        self, station: str, angles_rad: tuple[float, float], rates_rad_s: tuple[float, float], sigma_rad: float
    ) -> None:
        """Start one PTU's states anew from readings, with no memory of before."""
        x, P = self.state, self.covariance
        super().set_angles(station, angles_rad, rates_rad_s, sigma_rad)
        F = np.eye(self.layout.size)
        for part in (self.layout.angles[station], self.layout.rates[station]):
            F[part, part] = 0.0
        self._went(self.time_s, x, P, F)

    def start_target(
        self,
        position_m: FloatArray,
        velocity_m_s: FloatArray,
        covariance: FloatArray,
        age_s: float = 0.0,
        *,
        triangulated: bool = False,
    ) -> None:
        """Begin a target, as `StationEkf` does; one that is held ends here."""
        step = StartStep(
            position_m=position_m,
            velocity_m_s=velocity_m_s,
            covariance=covariance,
            age_s=age_s,
            triangulated=triangulated,
        )
        self.steps.append(step)
        self._cut()
        super().start_target(position_m, velocity_m_s, covariance, age_s, triangulated=triangulated)

    def _begin_again(self, start: ProvisionalTrack) -> None:
        """Begin again, as `StationEkf` does; it follows from the steps that are noted and is none itself."""
        self._cut()
        super()._begin_again(start)

    def drop_target(self) -> None:
        """Forget the target; the PTUs' angles and what was learnt of the rig stay."""
        self.steps.append(DropStep())
        self._cut()
        super().drop_target()

    def update_pixel(
        self,
        station: str,
        pixel: FloatArray,
        covariance_px2: FloatArray,
        row_dt_s: float = 0.0,
        correlated_share: float = 0.0,
    ) -> Innovation | None:
        """Fuse one camera's pixel, as `StationEkf` does; one that places the target anew ends what was before."""
        step = PixelStep(
            station=station,
            pixel=pixel,
            covariance_px2=covariance_px2,
            row_dt_s=row_dt_s,
            correlated_share=correlated_share,
        )
        self.steps.append(step)
        x, P = self.state, self.covariance
        innovation = super().update_pixel(station, pixel, covariance_px2, row_dt_s, correlated_share)
        if innovation is not None and _replaced(innovation):
            self._began_anew(x, P)
        return innovation

    def update_width(self, station: str, width_px: float, span_m: float, *, alone: bool) -> Innovation | None:
        """Fuse a silhouette's width, as `StationEkf` does."""
        self.steps.append(WidthStep(station=station, width_px=width_px, span_m=span_m, alone=alone))
        return super().update_width(station, width_px, span_m, alone=alone)

    def absorb_miss(self, station: str, detection_probability: float) -> None:
        """Take in that a camera which looked has seen nothing, as `StationEkf` does."""
        self.steps.append(MissStep(station=station, detection_probability=detection_probability))
        super().absorb_miss(station, detection_probability)

    def update_reference(
        self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float = 0.0, *, may_replace: bool = True
    ) -> Innovation:
        """Fuse a reference position, as `StationEkf` does; one that replaces the target's own ends what was before."""
        step = ReferenceStep(
            position_m=position_m, covariance_m2=covariance_m2, ahead_s=ahead_s, may_replace=may_replace
        )
        self.steps.append(step)
        x, P = self.state, self.covariance
        innovation = super().update_reference(position_m, covariance_m2, ahead_s, may_replace=may_replace)
        if _replaced(innovation):
            self._began_anew(x, P)
        return innovation

    def _open_reference_clock(self) -> None:
        """Doubt the reference's clock, as `StationEkf` does; it follows from a step that is noted."""
        x, P = self.state, self.covariance
        super()._open_reference_clock()
        self._went(self.time_s, x, P, np.eye(self.layout.size))

    def _age_span(self, width_px: float) -> None:
        """Let the span's error age, as `StationEkf` does; it follows from a step that is noted."""
        x, P = self.state, self.covariance
        super()._age_span(width_px)
        if self.covariance is not P:
            self._went(self.time_s, x, P, np.eye(self.layout.size))

    # --------------------------------------------------------------------------------- what is asked
    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity (runway frame) and (6, 6) covariance at ``t_s``, given all that is fused so far.

        Ahead of the filter's time, by the motion model with its noise. Behind it, by going back along the tape: the
        newer measurements sharpen it, and no noise is added. Where the tape does not reach, by the motion model
        backwards, with its noise.
        """
        at = self.passed(t_s)
        return super().kinematics_at(t_s) if at is None else at

    def passed(self, t_s: float) -> Kinematics | None:
        """Return the target at a time that the filter has passed; None ahead of it and where the tape ends."""
        if self.time_s is None or not self.has_target or t_s >= self.time_s - ROUNDING_S:
            return None
        x, P = self.state, self.covariance
        for record in reversed(self.tape):
            if isinstance(record, Cut):
                return None
            if record.t_s <= t_s < record.next_s:
                return self.kinematics_of(*back_into(record, t_s, x, P, self.motion_over))
            x, P = back(record, x, P)
        return None

    def finish_tape(self) -> None:
        """End the tape: nothing will be changed any more."""
        self._cut()
        self.tape.release(self.tape.mark)

    def _cut(self) -> None:
        if self.has_target and self.time_s is not None:
            self.tape.append(Cut(t_s=self.time_s, x=self.state, P=self.covariance))

    def _began_anew(self, x: FloatArray, P: FloatArray) -> None:
        """Put on the tape that nothing of the target before is in the target now."""
        F = np.eye(self.layout.size)
        F[self.layout.target, self.layout.target] = 0.0
        self._went(self.time_s, x, P, F)

    def _went(self, from_s: float | None, x: FloatArray, P: FloatArray, F: FloatArray) -> None:
        """Put a step from ``x``, ``P`` to the present state on the tape."""
        if not self.has_target:
            return
        start_s = -math.inf if from_s is None else from_s
        now_s = start_s if self.time_s is None else self.time_s
        self.tape.append(
            Transition(
                t_s=start_s,
                next_s=now_s,
                x=x,
                P=P,
                F=F,
                x_next=self.state,
                P_next=self.covariance,
                weights=self._bank.weights,
            )
        )
