"""The extended Kalman filter of the aircraft, the PTU angles and the errors of rig and clocks.

Measurements are fused one by one at their own times: encoder readings of a station, pixels of a camera, reference
positions. Updates are in Joseph form. The paper's Section 4.2; the equations are derived in docs/derivation.md.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import correlated_part, innovation_covariance, squared_sigmas
from groundstation.estimation.config import CalibrationUse, OutOfViewWeighting
from groundstation.estimation.field_of_view import moments_after_miss, paper_weight, probability_in_view
from groundstation.estimation.filter_core import FilterCore
from groundstation.estimation.linearisation import Linearised
from groundstation.estimation.measurement import LinearPrediction
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.reference_clock import REFERENCE_CLOCK, has_stepped
from groundstation.estimation.second_view import Seen
from groundstation.estimation.silhouette import lasting_variance
from groundstation.estimation.triangulation import midpoint
from groundstation.geometry.station import LensError
from groundstation.messages import Innovation

# initial sigma of the rate of an axis
INITIAL_RATE_SIGMA_RAD_S = math.radians(20.0)
# error of a velocity estimated without a reference, due to calibration errors: share of the speed, and a constant
_ADOPTED_SPEED_SHARE, _ADOPTED_SPEED_M_S = 0.4, 2.0
_REFUSED_IN_A_ROW = 5
_OPEN_SHARE = 0.5  # of the sigma before
_NOTHING = np.zeros((2, 2))
# no iteration of the update if the prediction is no more uncertain than this many sigmas of the pixel noise
_SETTLED_SIGMA = 2.0
# a re-initialisation is tested if the prediction is more uncertain by this factor
_VAGUE_SIGMA = 2.0
# a missed detection has no effect if the probability inside the image is this close to 0 or 1
_HARDLY = 0.02


class StationEkf(FilterCore):
    """`FilterCore` with its updates: encoder readings, pixels, silhouette widths, missed detections, references."""

    @contextmanager
    def predicted_ahead(self, t_s: float) -> Iterator[None]:
        """Predict the filter to ``t_s`` inside the block, for read-only use.

        The state is restored exactly at the end and nothing is recorded. An earlier time has no effect.
        """
        kept = self._imm, self.time_s
        try:
            if self.time_s is not None and t_s > self.time_s:
                self._imm = self._imm.copy()
                FilterCore._propagate(self, self.time_s, t_s)
            yield
        finally:
            self._imm, self.time_s = kept

    def update_encoder(
        self, station: str, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> Innovation:
        """Fuse one reading of pan and tilt, valid ``ahead_s`` after the filter time.

        ``clock_sigma_s`` is treated as noise of each reading unless the clock error is a state. A reading beyond the
        gate is not fused; the angle covariance is inflated by the residual, since the next reading decides whether
        it is an outlier or a jerk of the PTU.
        """
        if station not in self._read:
            self.set_angles(station, angles_rad, (0.0, 0.0), sigma_rad)
            return Innovation(residual=np.zeros(2), covariance=np.eye(2) * sigma_rad**2, nis=0.0, dof=0, accepted=True)
        model = self._encoders[station]
        variance = sigma_rad**2 + self._config.ptu_acceleration_psd_rad2_s3 * abs(ahead_s) ** 3 / 3.0
        noise = (variance, 0.0 if model.carries_clock else clock_sigma_s)
        if self._learns_clocks and station in self._watch.squares:
            # includes this reading, before it is used to estimate the clock errors
            square = model.squares(self.state, self.covariance, angles_rad, ahead_s, *noise)
            self._watch = self._watch.read(station, square / 2.0)
        read = model.fuse(self._imm, angles_rad, ahead_s, *noise, self._config.encoder_gate_sigma, self._estimated())
        if not read.accepted:
            self._imm.inflate(self.layout.angles[station], read.residual**2)
        return read

    def set_angles(
        self,
        station: str,
        angles_rad: tuple[float, float],
        rates_rad_s: tuple[float, float],
        sigma_rad: float,
        rate_sigma_rad_s: float = INITIAL_RATE_SIGMA_RAD_S,
    ) -> None:
        """Reset the states of one PTU from readings, without correlation to the previous ones."""
        self._imm.set_states(self.layout.angles[station], np.array(angles_rad), np.eye(2) * sigma_rad**2)
        self._imm.set_states(self.layout.rates[station], np.array(rates_rad_s), np.eye(2) * rate_sigma_rad_s**2)
        self._read |= {station}

    def update_pixel(
        self,
        station: str,
        pixel: FloatArray,
        covariance_px2: FloatArray,
        row_dt_s: float = 0.0,
        correlated_share: float = 0.0,
    ) -> Innovation | None:
        """Fuse the target pixel (2,) of one camera with covariance (2, 2); None if the target is behind the camera.

        ``correlated_share`` of that covariance is a time-correlated error, shared with the next pixels of the station.
        Near and beyond the image border the pixel is weighted (`OutOfViewWeighting`); beyond the chi-square gate it is
        rejected.
        """
        x, P = self.state, self.covariance
        prediction = self._pixels[station].predict(x, row_dt_s, self._age_s())
        if prediction is None:
            return None
        H, R = prediction.jacobian, covariance_px2
        in_view = innovation_covariance(P, H, _NOTHING)
        measured = pixel
        offset = self.layout.offsets.get(station)
        if offset is not None and correlated_share > 0.0:
            H, measured = H.copy(), pixel.copy()
            correlated_part(H, x, covariance_px2, offset.start, correlated_share, measured)
            R = (1.0 - correlated_share) * covariance_px2
        if in_view[0, 0] + in_view[1, 1] > _VAGUE_SIGMA**2 * (covariance_px2[0, 0] + covariance_px2[1, 1]):
            placed = self._reinitialise_range(
                Seen(station=station, pixel=pixel, covariance_px2=covariance_px2, row_dt_s=row_dt_s)
            )
            if placed is not None:
                return placed
        residual = measured - prediction.pixel
        S = innovation_covariance(P, H, R)
        nis = squared_sigmas(residual, S)
        accepted = nis <= self._gate
        if accepted:
            moved, gain_share = residual, 1.0
            size = self._stations[station].image_size_px
            inside = max(probability_in_view(prediction.pixel, in_view, size), 1e-6)
            if self._config.out_of_view is OutOfViewWeighting.PAPER:
                moved = paper_weight(prediction.pixel, size, self._config.paper_border_sigma_px) * residual
            else:
                if self._config.out_of_view is OutOfViewWeighting.GAIN:
                    gain_share = inside
                else:
                    R = R / inside
                if in_view[0, 0] > _SETTLED_SIGMA**2 * R[0, 0] or in_view[1, 1] > _SETTLED_SIGMA**2 * R[1, 1]:
                    state = (x, P, self._estimated())
                    first = Linearised(jacobian=H, residual=residual)
                    seen = self._linearisation.iterated(station, measured, first, state, R, (row_dt_s, self._age_s()))
                    H, moved = seen.jacobian, seen.residual
            if self._linearisation.carries_clock(station):
                R = R + self._linearisation.speed_noise(station, H, P, self._age_s())
                if self._learns_clocks:
                    R += self._linearisation.passage_noise(station, H, (x, P), self._age_s(), self._motions[0])
            self._imm.correct(moved, H, R, self._estimated(), updates_weights=True, share=gain_share)
            self._note_contribution(station)
        if self._provisional is not None:
            self._judge_provisional(self._provisional.after(accepted=accepted))
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)

    def _judge_provisional(self, track: ProvisionalTrack) -> None:
        """Confirm a provisional track, or restart it if its first pixels were outliers."""
        self._provisional = None if track.confirmed else track
        if track.refuted:
            self._restart_provisional(track)

    def _restart_provisional(self, start: ProvisionalTrack) -> None:
        self.starts_taken_back += 1
        self._provisional = replace(start, accepted=0, refused=0, consecutive_refusals=0)
        self._place_target(start, 0.0 if self.time_s is None else self.time_s - start.t_s)

    def _reinitialise_range(self, seen: Seen) -> Innovation | None:
        """Re-initialise a target tracked by one other camera at the intersection of the two rays, if applicable."""
        x, P, age_s = self.state, self.covariance, self._age_s()
        held = self._second_view.holder(seen, x, P, age_s)
        if held is None:
            return None
        try:
            rays = [
                self._stations[v.station].ray(v.pixel[0], v.pixel[1], *self.angles(v.station)) for v in (held, seen)
            ]
        except LensError:
            return None
        meeting = midpoint(rays)
        if meeting is None:
            return None
        placed = self._second_view.place((held, seen), rays[0].origin_runway_m, meeting[0], (x, P), age_s)
        if placed is None or placed.square > self._width_gate:
            return None
        self._imm.set_states(self.layout.target, placed.target, placed.covariance)
        self._imm.correlate(self.layout.target, self.layout.constant, placed.sensitivity)
        R = placed.residual_covariance
        return Innovation(residual=placed.residual, covariance=R, nis=placed.square, dof=1, accepted=True)

    def update_reference(
        self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float = 0.0, *, may_replace: bool = True
    ) -> Innovation:
        """Fuse a reference position of the target (3,) with covariance (3, 3), stamped ``ahead_s`` after now.

        For some time after it (`EstimationConfig.reference_hold_s`) the carried errors are also estimated from pixels.
        The first reference of a target replaces its position: the position from pixels may be tens of metres off due
        to the errors that are to be estimated, too far for a linearisation. A reference after several rejected ones
        does so, too. Neither applies once the rig errors are estimated, so that a receiver fault cannot replace a good
        track.

        Without ``may_replace`` (the position is confirmed by other measurements) rejected references never replace the
        position, and the first one does only inside the gate, where the prior errors of rig and clocks explain the
        residual. A receiver that was rejected this way replaces nothing until one of its positions is accepted.
        """
        teaches = self._config.calibration is CalibrationUse.REFERENCE and self._rig_is_open()
        if self._watch_reference_clock(position_m, covariance_m2, ahead_s):
            self._reopen_reference_clock()
        expected, R = self._expect_reference(covariance_m2, ahead_s)
        residual = position_m - expected.value
        S = innovation_covariance(self.covariance, expected.jacobian, R)
        nis = float(residual @ np.linalg.solve(S, residual))
        if teaches and self._replaces(nis, may_replace=may_replace):
            return self._adopt_reference(position_m, covariance_m2, ahead_s)
        accepted = nis <= self._reference_gate
        self._references_refused = self._references_refused + 1 if may_replace and not accepted else 0
        # a receiver that contradicted other measurements has to be accepted once before it may replace the position
        self._reference_contradicted = not accepted and (self._reference_contradicted or not may_replace)
        if accepted:
            self._newest_reference_s = self.time_s if self.time_s is not None else -math.inf
            self._provisional = None
            self._imm.correct(residual, expected.jacobian, R, self._estimated(), updates_weights=True)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=3, accepted=accepted)

    def _replaces(self, nis: float, *, may_replace: bool) -> bool:
        """Return whether a reference with this NIS replaces the position, for a rig that is not yet estimated."""
        may_replace = may_replace and not self._reference_contradicted
        if self._newest_reference_s == -math.inf:
            return may_replace or nis <= self._reference_gate
        return may_replace and self._references_refused >= _REFUSED_IN_A_ROW

    def _expect_reference(self, covariance_m2: FloatArray, ahead_s: float) -> tuple[LinearPrediction, FloatArray]:
        """Return the predicted reference position and its noise (3, 3), for a stamp ``ahead_s`` after now."""
        expected = self._reference.predict(self.state, ahead_s, self._age_s())
        # process noise and velocity error between the filter time and the time of validity
        away, doubt = self._reference.lateness_s(self.state, self.covariance, ahead_s, self._age_s())
        here, speed = self.layout.position, self.layout.velocity
        R = covariance_m2 + self._motions[0].process_noise(math.hypot(away, doubt))[here, here]
        return expected, R + doubt**2 * self.covariance[speed, speed]

    def _watch_reference_clock(self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float) -> bool:
        """Return whether the residual of a reference indicates a step of its clock, which was estimated before.

        Never for the first reference of a target.
        """
        place = self.layout.parameters.get(REFERENCE_CLOCK)
        if place is None or self._newest_reference_s == -math.inf:
            return False
        if self.covariance[place, place] > (_OPEN_SHARE * self._config.reference_clock_sigma_s) ** 2:
            return False
        expected, R = self._expect_reference(covariance_m2, ahead_s)
        S = innovation_covariance(self.covariance, expected.jacobian, R)
        return has_stepped(position_m - expected.value, S, self.state[self.layout.velocity])

    def _reopen_reference_clock(self) -> None:
        """Inflate the error of the reference clock by the prior variance of an unknown clock."""
        place = self.layout.parameters[REFERENCE_CLOCK]
        self._imm.inflate(slice(place, place + 1), np.array([self._config.reference_clock_sigma_s**2]))

    def _rig_is_open(self) -> bool:
        """Return whether the uncertainty of some mount or boresight is still close to that of the rig file."""
        if not self._rig_uncertain:
            return False
        shares = [
            error.sigma / error.prior_sigma
            for error in self.carried_errors()
            if error.name.partition(".")[2].startswith(("runway_from_base", "head_from_camera"))
        ]
        return not shares or max(shares) > _OPEN_SHARE

    def _adopt_reference(self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float) -> Innovation:
        """Set the target to a reference position, with the uncertainty and correlations of its clock and antenna."""
        expected = self._reference.predict(self.state, ahead_s, self._age_s())
        residual = position_m - expected.value
        velocity = self.state[self.layout.velocity].copy()
        spread = self.covariance[self.layout.velocity, self.layout.velocity].copy()
        spread += np.eye(3) * (_ADOPTED_SPEED_SHARE * float(np.linalg.norm(velocity)) + _ADOPTED_SPEED_M_S) ** 2
        away, doubt = self._reference.lateness_s(self.state, self.covariance, ahead_s, self._age_s())
        here = self.layout.position
        around = covariance_m2 + (away**2 + doubt**2) * spread
        around += self._motions[0].process_noise(math.hypot(away, doubt))[here, here]
        place = np.concatenate([self.state[here] + residual, velocity])
        # the position is propagated with the velocity, so that their errors are correlated
        self._imm.set_states(self.layout.target, place, np.block([[around, -away * spread], [-away * spread, spread]]))
        self._imm.correlate(self.layout.position, self.layout.constant, -expected.jacobian[:, self.layout.constant])
        self._newest_reference_s = self.time_s if self.time_s is not None else -math.inf
        self._references_refused, self._reference_contradicted = 0, False
        self._provisional = None
        return Innovation(residual=residual, covariance=around, nis=0.0, dof=0, accepted=True)

    def update_width(self, station: str, width_px: float, span_m: float, *, alone: bool) -> Innovation | None:
        """Fuse the width of the target's silhouette in one camera, px: log w = log(span · f / depth · aspect).

        The error of ``span_m`` is a state (`groundstation.estimation.parameters.LOG_SPAN`), so that many widths do not
        average it out. ``alone`` means that no other camera sees the target: the width then updates the range,
        otherwise only the span. None if the aspect is too oblique, or the span is no state.
        """
        expected = self._widths[station].predict(self.state, span_m, *self.angles(station))
        if expected is None or width_px <= 0.0:
            return None
        self._inflate_span(width_px)
        residual = np.array([math.log(width_px)]) - expected.value
        R = np.array([[self._config.width_sigma_log**2]])
        S = innovation_covariance(self.covariance, expected.jacobian, R)
        nis = float(residual[0] ** 2 / S[0, 0])
        accepted = nis <= self._width_gate
        if accepted:
            estimated = self._estimated() if alone else self._span_only
            self._imm.correct(residual, expected.jacobian, R, estimated, updates_weights=False)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=1, accepted=accepted)

    def _inflate_span(self, width_px: float) -> None:
        """Inflate the span error by the time since the last width, faster for smaller silhouettes."""
        if self._span is None or self.time_s is None or not self._span_ages:
            return
        if self._width_s is not None and self.time_s > self._width_s:
            grown = lasting_variance(width_px, self.time_s - self._width_s)
            self._imm.inflate(slice(self._span, self._span + 1), np.array([grown]))
        self._width_s = self.time_s

    def update_miss(self, station: str, detection_probability: float) -> None:
        """Update with a missed detection of one camera.

        The predicted density inside the image is multiplied by 1 − P_D and replaced by the Gaussian with the moments
        of the result. There is no effect if the prediction is completely inside, or behind the camera.
        """
        prediction = self.predict_pixel(station)
        if prediction is None:
            return
        S = self.pixel_covariance(prediction)
        size = self._stations[station].image_size_px
        inside = probability_in_view(prediction.pixel, S, size)
        if _HARDLY < inside < 1.0 - _HARDLY:
            mean, covariance = moments_after_miss(prediction.pixel, S, size, detection_probability)
            self._imm.replace_moments(prediction.jacobian, mean - prediction.pixel, covariance, self._estimated())
