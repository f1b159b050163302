"""State of the filter at one time: mean, covariance and bookkeeping; each change of it is recorded in the journal."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.clock_monitor import ClockMonitor
from groundstation.estimation.ekf_snapshot import EkfBookkeeping, EkfSnapshot
from groundstation.estimation.filter_models import FilterModels
from groundstation.estimation.imm import ImmState
from groundstation.estimation.journal import FilterJournal, JournalRecord
from groundstation.estimation.kalman_kernels import BoolArray
from groundstation.estimation.parameters import ParameterPrior, time_places
from groundstation.estimation.rejected_pixels import RejectedPixels
from groundstation.estimation.updates.apply import apply_correction, reset_transition
from groundstation.estimation.updates.measurements import TargetPixel
from groundstation.estimation.updates.update import Correction, PredictedState


class FilterState:
    """State of one filter.

    Parameters
    ----------
    models : of the filter.
    prior : of the carried errors.
    journal : receives measurements and transitions; without it nothing is recorded.

    ``imm`` and ``book`` are replaced with each change, never written to.
    """

    def __init__(self, models: FilterModels, prior: ParameterPrior, journal: FilterJournal | None) -> None:
        self.models, self.journal = models, journal
        self.time_s: float | None = None
        layout = models.layout
        self.imm = models.arithmetic.imm(layout.size, models.motion.stay_s)
        self.imm.set_states(layout.constant, np.zeros(len(prior.names)), prior.covariance)
        clocks = {name: time_places(layout.parameters, name) for name in layout.angles}
        self.book = EkfBookkeeping(clock_monitor=ClockMonitor.of(clocks))

    @property
    def learns(self) -> bool:
        """Whether the carried errors are estimated at present; otherwise they are consider parameters."""
        book = self.book
        return self.models.consider.learns(self.time_s, book.references.newest_s, book.newest_pixel_s)

    def estimated(self) -> BoolArray:
        """Return which states (n,) an update estimates at present; the others are considered."""
        unobservable = self.book.clock_monitor.quiet() if self.models.consider.learns_clocks else []
        return self.models.consider.estimated(unobservable, learns=self.learns)

    def predicted(self) -> PredictedState:
        """Return the present state, as input of a measurement update."""
        return PredictedState(self.imm.state, self.estimated(), self.age_s(), self._alone(self.time_s))

    def age_s(self) -> float:
        """Return the time since the first prediction, for clock drifts."""
        first_s = self.book.first_s
        return 0.0 if self.time_s is None or first_s is None else self.time_s - first_s

    def snapshot(self) -> EkfSnapshot:
        """Return the complete state of the filter."""
        return EkfSnapshot(self.time_s, self.imm.state, self.book, None if self.journal is None else self.journal.mark)

    def restore(self, saved: EkfSnapshot) -> None:
        """Restore a `snapshot`; journal records made since then are removed."""
        self.time_s, self.imm.state, self.book, mark = saved
        if self.journal is not None and mark is not None:
            self.journal.truncate(mark)

    def predict_to(self, t_s: float) -> None:
        """Predict the state to ``t_s``; an earlier time has no effect."""
        if self.time_s is None:
            self.time_s = t_s
            self.note(first_s=t_s)
        from_s = self.time_s
        if t_s > from_s:
            before = self.imm.state
            self._record_transition(from_s, before, self._propagate(from_s, t_s))

    def _propagate(self, from_s: float, to_s: float) -> FloatArray:
        """Predict the state from its time to a later one and return the transition F (n, n)."""
        F, noises = self.models.motion.over(to_s - from_s, self.seen_motion(from_s, to_s))
        if not self.book.has_target:
            noises[:, self.models.layout.target, self.models.layout.target] = 0.0
        self.imm.predict(F, noises, to_s - from_s)
        self.time_s = to_s
        return F

    def motion_to(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Return F and Q, (n, n) each, from the filter's time to another."""
        now_s = t_s if self.time_s is None else self.time_s
        seen = self.seen_motion(now_s, t_s) if t_s > now_s else None
        return self.models.motion.mixed_over(t_s - now_s, self.imm.weights_after(abs(t_s - now_s)), seen)

    def seen_motion(self, from_s: float, to_s: float) -> FloatArray | None:
        """Return the mean density (3,) of acceleration that this target has shown; None while two cameras see it."""
        known_s = self.book.two_cameras_s
        if known_s is None or self._alone(to_s) is None:
            return None
        return self.book.velocity.mean_density(max(from_s - known_s, 0.0), to_s - known_s)

    def _alone(self, t_s: float | None) -> str | None:
        """Return the station that has seen the target alone for some time, without a reference position either."""
        known_s, after_s = self.book.two_cameras_s, self.models.alone_after_s
        if known_s is None or t_s is None or not self.book.has_target:
            return None
        if t_s - known_s <= after_s or t_s - self.book.references.newest_s <= after_s:
            return None
        return "" if self.book.pixel is None else self.book.pixel[0]

    def count_pixel(self, station: str, *, accepted: bool) -> None:
        """Note an accepted pixel; sample the velocity while two cameras see the target."""
        if self.time_s is None or not accepted:
            return
        book, now_s = self.book, self.time_s
        changes: dict[str, Any] = {"pixel": (station, now_s), "rejected": book.rejected.accepted(now_s)}
        together = book.pixel is not None and book.pixel[0] != station
        if together and book.pixel is not None and now_s - book.pixel[1] <= self.models.alone_after_s:
            changes["two_cameras_s"] = now_s
            if book.velocity.is_due(now_s):
                where, imm = self.models.layout.velocity, self.imm
                changes["velocity"] = book.velocity.sampled(now_s, imm.x[where], imm.P[where, where])
        if self.models.consider.keeps_pixel_times:
            changes["newest_pixel_s"] = {**book.newest_pixel_s, station: now_s}
        # at once: a replacement of all fields costs a tenth of an update
        self.note(**changes)

    def is_contradicted(self, pixel: TargetPixel, residual_px: FloatArray) -> bool:
        """Count a rejected pixel; where a run of them contradicts the filter, widen the target's covariance."""
        if self.time_s is None or self.book.provisional is not None or not math.isfinite(self.models.alone_after_s):
            return False
        if pixel.correlated_share > 0.0:
            # of the program's own detector: a tree lies on a smooth path past the prediction, too
            return False
        rejected = self.book.rejected.rejected(pixel.station, self.time_s, residual_px, pixel.covariance_px2)
        self.note(rejected=rejected)
        prediction = self.models.pixels[pixel.station].predict(self.imm.x, pixel.row_dt_s, self.age_s())
        if prediction is None or not rejected.contradict:
            return False
        self._widen_target(rejected.doubt(prediction.jacobian[:, self.models.layout.position]))
        return True

    def _widen_target(self, covariance: FloatArray) -> None:
        """Add (6, 6) to the covariance of position and velocity."""
        before = self.imm.state
        F, noises = self.models.motion.over(0.0)
        noises[:, self.models.layout.target, self.models.layout.target] += covariance
        self.imm.predict(F, noises, 0.0)
        self._record_transition(self.time_s, before, F)

    @contextmanager
    def predicted_ahead(self, t_s: float) -> Iterator[None]:
        """Predict the filter to ``t_s`` inside the block, for read-only use.

        The state is restored exactly at the end and nothing is recorded. An earlier time has no effect.
        """
        kept = self.imm.state, self.time_s
        try:
            if self.time_s is not None and t_s > self.time_s:
                self._propagate(self.time_s, t_s)
            yield
        finally:
            self.imm.state, self.time_s = kept

    def set_angles(
        self,
        station: str,
        angles_rad: tuple[float, float],
        rates_rad_s: tuple[float, float],
        sigma_rad: float,
        rate_sigma_rad_s: float,
    ) -> None:
        """Reset the states of one PTU from readings, without correlation to the previous ones."""
        before, angles, rates = self.imm.state, self.models.layout.angles[station], self.models.layout.rates[station]
        self.imm.set_states(angles, np.array(angles_rad), np.eye(2) * sigma_rad**2)
        self.imm.set_states(rates, np.array(rates_rad_s), np.eye(2) * rate_sigma_rad_s**2)
        self.note(stations_read=self.book.stations_read | {station})
        self._record_transition(self.time_s, before, reset_transition(self.models.layout, angles, rates))

    def begin_target(self) -> None:
        """Note a new target; how the last one moved is kept, as it is most likely the same."""
        velocity = self.book.velocity.interrupted()
        self.note(has_target=True, newest_width_s=None, pixel=None, two_cameras_s=self.time_s, velocity=velocity)
        self.note(rejected=RejectedPixels())

    def note(self, **changes: Any) -> None:
        """Replace fields of the bookkeeping."""
        self.book = replace(self.book, **changes)

    def apply(self, correction: Correction | None) -> None:
        """Apply the correction of an update, and record it where it is a transition for the smoother."""
        before = self.imm.state
        F = apply_correction(self.imm, correction, self.models.layout, self.estimated)
        if F is not None:
            self._record_transition(self.time_s, before, F)

    def close_history(self) -> None:
        """End the history and release all its records."""
        self.end_track()
        if self.journal is not None:
            self.journal.history.release(self.journal.history.mark)

    def add_to_journal(self, record: JournalRecord) -> None:
        """Add an operation to the journal."""
        if self.journal is not None:
            self.journal.add(record)

    def end_track(self) -> None:
        """Record the end of a track, if there is one."""
        if self.journal is not None and self.book.has_target and self.time_s is not None:
            self.journal.end_track(self.time_s, self.imm.x, self.imm.P)

    def _record_transition(self, from_s: float | None, before: ImmState, F: FloatArray) -> None:
        """Record the transition by ``F`` (n, n) from the state ``before`` to now, while there is a target."""
        if self.journal is not None and self.book.has_target:
            times_s, now = (from_s, self.time_s), self.imm.state
            start, end = (before.mean, before.covariance), (now.mean, now.covariance)
            self.journal.add_transition(times_s, start, F, end, now.weights)
