"""A flight as a least-squares problem: effect of each parameter on each pixel (docs/derivation.md, section 16).

Parameters are differences from the rig's values, in rad, m, s, s/s. Names are ``station.parameter``: those of
`groundstation.geometry.calibration`, and

- ``camera_clock.offset``: lag of the exposures behind the rig's clock; ``camera_clock.drift`` about the
  middle of the flight,
- ``ptu_clock.offset``: the same for the PTU's readings,
- ``readout``: added to the rolling shutter's time from first row to last,

and without a station ``dgps_clock.offset`` (lag of the log's stamps behind session time) and
``dgps_antenna.x .y .z`` (added to the antenna's position from the nose).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from calibration.flight.reference_track import ReferenceTrack
from groundstation.arrays import FloatArray, MaskArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, perturbed_packed
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration_many
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.rig.rig import Station

ANTENNA = tuple(f"dgps_antenna.{axis}" for axis in "xyz")
DGPS_OFFSET = "dgps_clock.offset"
_TURNS = (slice(0, 3), slice(6, 9))
# what moves exposures past readings
_TIMES = ("camera_clock.offset", "camera_clock.drift", "ptu_clock.offset", "readout")
_SMALL_TURN = 1e-6
# rad, m, s/s, px
_STEP_SCALES = {
    "runway_from_base": 1e-3,
    "head_from_camera": 1e-3,
    "ptu_position": 0.1,
    "drift": 1e-5,
    "focal": 1.0,
    "principal": 1.0,
}
_OTHER_STEP = 0.01
# readings usually further apart than this do not show the motion of a head between them
SLOW_S = 0.035


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AngleCurve:
    """Pan and tilt in rad as splines of the PTU's stamps, from first to last reading of a stretch, s."""

    from_s: float
    to_s: float
    axes: tuple[BSpline, BSpline]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationObservations:
    """Observations of one station.

    Attributes
    ----------
    t_s : (n,) the frames' stamps, session clock as the rig has it.
    pixel_px, sigma_px : (n, 2) u and v and one sigma of each.
    sigma_given : whether the sigmas come with the pixels; otherwise they are relative only.
    row_share : (n,) the pixel's row from the middle row, in picture heights.
    readings_s, readings_rad : (m,), (m, 2) the PTU's stamps and pan and tilt, pan without jumps; none where fixed.
    max_gap_s : largest gap of readings that bracket an exposure.
    curves : smooth curves through intervals of readings; between them straight lines.
    own_readings : readings are slow, and each exposure has one of its own: while clocks are fixed the motion of the
        head between them is not needed.
    """

    t_s: FloatArray
    pixel_px: FloatArray
    sigma_px: FloatArray
    sigma_given: bool
    row_share: FloatArray
    readings_s: FloatArray
    readings_rad: FloatArray
    max_gap_s: float
    curves: tuple[AngleCurve, ...] = ()
    own_readings: bool = False

    def __len__(self) -> int:
        return len(self.t_s)

    def keep(self, mask: MaskArray) -> "StationObservations":
        """Return the observations of ``mask`` (n,) only."""
        return StationObservations(
            t_s=self.t_s[mask],
            pixel_px=self.pixel_px[mask],
            sigma_px=self.sigma_px[mask],
            sigma_given=self.sigma_given,
            row_share=self.row_share[mask],
            readings_s=self.readings_s,
            readings_rad=self.readings_rad,
            max_gap_s=self.max_gap_s,
            curves=self.curves,
            own_readings=self.own_readings,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AnglesAtObservations:
    """Pan and tilt (n, 2) rad, their rates (n, 2) rad/s, share (n,) of one reading's variance, ``usable`` (n,).

    ``curved`` (n,): they are those of a curve.
    """

    angles_rad: FloatArray
    rates_rad_s: FloatArray
    variance_share: FloatArray
    usable: MaskArray
    curved: MaskArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelPredictions:
    """Predicted pixels of one station's n observations, and their derivatives by p parameters.

    ``pixel_px`` (n, 2); ``jacobian`` (n, 2, p); ``covariance_px2`` (n, 2, 2) of pixel, angle and reference;
    ``usable`` (n,): there are angles and reference, and the point is in front of the camera. ``own_px2`` (n, 2, 2) is
    the covariance without that of the paths, which frames share: of the antenna at ``reference_s`` (n,) of its clock,
    with ``by_point_px_m`` (n, 2, 3), and of a head that has a curve, at ``reading_s`` (n,), with ``by_angle_px_rad``
    (n, 2, 2).
    """

    pixel_px: FloatArray
    jacobian: FloatArray
    covariance_px2: FloatArray
    usable: MaskArray
    own_px2: FloatArray
    by_point_px_m: FloatArray
    by_angle_px_rad: FloatArray
    reference_s: FloatArray
    reading_s: FloatArray


def angles_at(observed: StationObservations, t_s: FloatArray) -> AnglesAtObservations:
    """Return a station's angles at instants (n,), by its curves, otherwise between readings; zero if fixed."""
    n = len(t_s)
    t, angles = observed.readings_s, observed.readings_rad
    if len(t) < 2:
        nothing, there = np.zeros((n, 2)), np.full(n, len(t) == 0)
        return AnglesAtObservations(
            angles_rad=nothing,
            rates_rad_s=nothing,
            variance_share=np.zeros(n),
            usable=there,
            curved=np.zeros(n, dtype=np.bool_),
        )
    right = np.clip(np.searchsorted(t, t_s, side="left"), 1, len(t) - 1)
    gap = t[right] - t[right - 1]
    share = (t_s - t[right - 1]) / gap
    rates = (angles[right] - angles[right - 1]) / gap[:, None]
    found = angles[right - 1] + (t_s - t[right - 1])[:, None] * rates
    curved = np.zeros(n, dtype=np.bool_)
    for curve in observed.curves:
        inside = (t_s >= curve.from_s) & (t_s <= curve.to_s)
        curved |= inside
        for axis, spline in enumerate(curve.axes):
            found[inside, axis], rates[inside, axis] = spline(t_s[inside]), spline(t_s[inside], nu=1)
    return AnglesAtObservations(
        angles_rad=found,
        rates_rad_s=rates,
        variance_share=np.clip((1.0 - share) ** 2 + share**2, 0.5, 1.0),
        usable=(share >= -1e-9) & (share <= 1.0 + 1e-9) & (gap <= observed.max_gap_s + 1e-9),
        curved=curved,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightProblem:
    """Stations, their observations, the path flown, and the free parameters.

    Attributes
    ----------
    names : of the p free parameters; ``prior_sigma`` (p,) infinite without a prior.
    antenna_in_body_m : (3,) from the nose: x forward, y right, z down.
    """

    stations: Mapping[str, Station]
    observations: Mapping[str, StationObservations]
    track: ReferenceTrack
    antenna_in_body_m: FloatArray
    names: tuple[str, ...]
    prior_sigma: FloatArray

    @property
    def step_scale(self) -> FloatArray:
        """Typical steps (p,) of the parameters, for the trust region of the fit."""
        return np.array(
            [next((s for part, s in _STEP_SCALES.items() if part in name), _OTHER_STEP) for name in self.names]
        )

    def own(self, station: str) -> list[tuple[int, str]]:
        """Return place and short name of one station's parameters."""
        start = station + "."
        return [(k, name.removeprefix(start)) for k, name in enumerate(self.names) if name.startswith(start)]

    def curves(self, station: str) -> tuple[AngleCurve, ...]:
        """Return a head's curves; none where it takes none to know its angles at exposures."""
        observed = self.observations[station]
        timed = any(f"{station}.{name}" in self.names for name in _TIMES)
        return (
            () if observed.own_readings and not timed and self.stations[station].readout_s == 0.0 else observed.curves
        )

    def value(self, change: FloatArray, name: str) -> float:
        """Return one parameter of a change (p,); 0 where it is not free."""
        return float(change[self.names.index(name)]) if name in self.names else 0.0

    def station_change(self, change: FloatArray, station: str) -> FloatArray:
        """Return a station's geometry (21,) out of a change (p,)."""
        full = np.zeros(CALIBRATION_SIZE)
        for place, short in self.own(station):
            if short in CALIBRATION_PARAMETERS:
                full[CALIBRATION_PARAMETERS.index(short)] = change[place]
        return full

    def antenna_m(self, change: FloatArray) -> FloatArray:
        """Return the antenna's place (3,) m from the nose with a change (p,)."""
        return self.antenna_in_body_m + np.array([self.value(change, name) for name in ANTENNA])

    def middle_s(self, station: str) -> float:
        """Return the time about which a station's clock drifts."""
        t = self.observations[station].t_s
        return float(0.5 * (t[0] + t[-1])) if len(t) else 0.0

    def predict(self, station: str, change: FloatArray) -> PixelPredictions:
        """Predict one station's pixels with a change (p,) of the parameters."""
        observed, rig = self.observations[station], self.stations[station]
        from_middle = observed.t_s - self.middle_s(station)
        exposed = observed.t_s + self.value(change, f"{station}.camera_clock.offset")
        exposed = exposed + self.value(change, f"{station}.camera_clock.drift") * from_middle
        exposed = exposed + observed.row_share * (rig.readout_s + self.value(change, f"{station}.readout"))
        by_unit = exposed - self.value(change, f"{station}.ptu_clock.offset")
        angles = angles_at(replace(observed, curves=self.curves(station)), by_unit)
        by_log = exposed + self.value(change, DGPS_OFFSET)
        track = self.track.at(by_log)
        antenna = self.antenna_m(change)
        points = track.nose_m(antenna)

        n = len(observed)
        turn = self.station_change(change, station)
        pixel, by_state, by_rig = np.zeros((n, 2)), np.zeros((n, 2, 5)), np.zeros((n, 2, CALIBRATION_SIZE))
        depth = np.zeros(n)
        packed = perturbed_packed(rig.geometry().packed, turn)
        project_calibration_many(packed, points, angles.angles_rad, pixel, by_state, by_rig, depth)
        # the kernel's small angles rotate the already rotated frame
        for part in _TURNS:
            by_rig[:, :, part] = about_rotated(by_rig[:, :, part], turn[part])
        by_point, by_angle = by_state[:, :, :3], by_state[:, :, 3:]
        by_track = np.einsum("nij,nj->ni", by_point, track.nose_velocity_m_s(antenna))
        by_turning = np.einsum("nij,nj->ni", by_angle, angles.rates_rad_s)
        jacobian = self._clock_columns(station, by_track, by_turning, from_middle)
        for place, short in self.own(station):
            if short in CALIBRATION_PARAMETERS:
                jacobian[:, :, place] = by_rig[:, :, CALIBRATION_PARAMETERS.index(short)]
        by_antenna = -by_point @ track.runway_from_body
        for axis, name in enumerate(ANTENNA):
            if name in self.names:
                jacobian[:, :, self.names.index(name)] = by_antenna[:, :, axis]
        usable = angles.usable & track.usable & (depth > MIN_DEPTH_M)
        jacobian[~usable] = 0.0
        own, shared = self._pixel_covariances(station, angles, by_angle, by_point * track.sigma_m[:, None, :])
        own[~usable], shared[~usable] = np.eye(2), np.eye(2)
        return PixelPredictions(
            pixel_px=pixel,
            jacobian=jacobian,
            covariance_px2=shared,
            usable=usable,
            own_px2=own,
            by_point_px_m=np.where(usable[:, None, None], by_point, 0.0),
            by_angle_px_rad=np.where((usable & angles.curved)[:, None, None], by_angle, 0.0),
            reference_s=by_log,
            reading_s=by_unit,
        )

    def _clock_columns(
        self, station: str, by_track: FloatArray, by_turning: FloatArray, from_middle: FloatArray
    ) -> FloatArray:
        """Return the Jacobian (n, 2, p) with the columns of clocks and readout; the others are zero.

        ``by_track``, ``by_turning`` (n, 2) px/s: the pixels' motion by the aircraft and by the head.
        """
        later = by_track + by_turning
        columns: dict[str, FloatArray] = {
            "camera_clock.offset": later,
            "camera_clock.drift": later * from_middle[:, None],
            "ptu_clock.offset": -by_turning,
            "readout": later * self.observations[station].row_share[:, None],
        }
        jacobian = np.zeros((len(later), 2, len(self.names)))
        for place, short in self.own(station):
            if short in columns:
                jacobian[:, :, place] = columns[short]
        if DGPS_OFFSET in self.names:
            jacobian[:, :, self.names.index(DGPS_OFFSET)] = by_track
        return jacobian

    def _pixel_covariances(
        self, station: str, angles: AnglesAtObservations, by_angle: FloatArray, by_fix: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return each pixel's covariance (n, 2, 2) px² without and with the noise that paths share."""
        observed, n = self.observations[station], len(self.observations[station])
        noise = observed.sigma_px[:, :, None] ** 2 * np.eye(2)
        encoder = self.stations[station].angle_sigma_rad ** 2 * angles.variance_share
        by_readings = by_angle @ np.swapaxes(by_angle, 1, 2) * encoder[:, None, None]
        own = noise + np.where(angles.curved[:, None, None], 0.0, by_readings)
        # pixels between the same two fixes share these fixes' noise
        crowd = max(1.0, self.track.step_s * (n - 1) / max(float(np.ptp(observed.t_s)), 1e-9)) if n > 1 else 1.0
        return own, noise + by_readings + crowd * by_fix @ np.swapaxes(by_fix, 1, 2)


def about_rotated(derivative: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return derivatives (n, 2, 3) by a rotation vector (3,) in rad, given those by a further small rotation."""
    # one product: as many as there are pixels take four times as long (of 300)
    return np.asarray((derivative.reshape(-1, 3) @ left_jacobian(turn_rad)).reshape(derivative.shape))


def left_jacobian(turn_rad: FloatArray) -> FloatArray:
    """Return J (3, 3) with exp([θ + dθ]×) = exp([J dθ]×) exp([θ]×), for a rotation vector θ (3,) in rad."""
    # Python's numbers: with NumPy's it takes twice as long, in each prediction of a fit
    x, y, z = turn_rad.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    first, second = 0.5, 0.0
    if angle >= _SMALL_TURN:
        first = (1.0 - math.cos(angle)) / angle**2
        second = (angle - math.sin(angle)) / angle**3
    # I + first [θ]× + second [θ]×², with [θ]×² = θ θᵀ − |θ|² I
    across = 1.0 - second * angle * angle
    return np.array(
        [
            [across + second * x * x, second * x * y - first * z, second * x * z + first * y],
            [second * x * y + first * z, across + second * y * y, second * y * z - first * x],
            [second * x * z - first * y, second * y * z + first * x, across + second * z * z],
        ]
    )
