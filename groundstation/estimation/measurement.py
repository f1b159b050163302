"""The measurement models: a camera's pixel, a PTU's angles and a reference position, with their Jacobians.

Pixel: the pinhole chain of docs/conventions.md. ∂pixel/∂angle is not zero; through it encoder noise is
shared between pixel and angles, as the paper's Equation 5 has it. With a rolling shutter the row is exposed
some time after the stamp, and with a clock error the whole picture is: by δ later the target is at p + δ·v and
the PTU at its angle + δ·rate. So a clock error enters as the time does, and ∂z/∂δ is the pixel's own speed. A shutter
that takes longer by ρ makes a row later by its share of the picture's height from the middle row times ρ.

A PTU's angles are states in the PTU's own clock: its readings show them as they are, and a clock that is late by ε
enters where a pixel meets them, as angle − ε·rate. (Were ε to enter at the reading, each reading would multiply it by a
rate that is made of the very noise of the readings, and the filter would learn ε from noise.)
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import BoolArray, innovation_covariance, squared_sigmas
from groundstation.estimation.imm import ImmFilter, correct_modes
from groundstation.estimation.parameters import DGPS_ANTENNA, DGPS_CLOCK
from groundstation.estimation.state import StateLayout
from groundstation.geometry import kernels
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.calibration import parameter_indices, perturbed_packed
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation
from groundstation.rig.covariance import READOUT

IndexArray = NDArray[np.int64]
_NOWHERE = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelPrediction:
    """Predicted pixel (2,) with its Jacobian H (2, n) over the state, px per state unit."""

    pixel: FloatArray
    jacobian: FloatArray
    depth_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearPrediction:
    """A predicted measurement (m,) with its Jacobian H (m, n) over the state."""

    value: FloatArray
    jacobian: FloatArray


class PixelModel:
    """One station's camera: where the state puts the target in its image."""

    def __init__(self, layout: StateLayout, geometry: StationGeometry) -> None:
        self._geometry = geometry
        self._size = layout.size
        self._rows = geometry.image_size_px[1]
        name = geometry.name
        own = {p.removeprefix(f"{name}."): k for p, k in layout.parameters.items() if p.startswith(f"{name}.")}
        calibration = {p: k for p, k in own.items() if "_clock." not in p and p != READOUT}
        self._readout = own.get(READOUT, _NOWHERE)
        self._columns = np.array(parameter_indices(list(calibration)), np.int64)
        self._places = np.array(list(calibration.values()), np.int64)
        angles, rates = layout.angles.get(name), layout.rates.get(name)
        self._where = np.array(
            [
                layout.position.start,
                layout.velocity.start,
                _NOWHERE if angles is None else angles.start,
                _NOWHERE if rates is None else rates.start,
                own.get("camera_clock.offset", _NOWHERE),
                own.get("camera_clock.drift", _NOWHERE),
                own.get("ptu_clock.offset", _NOWHERE),
                own.get("ptu_clock.drift", _NOWHERE),
            ],
            np.int64,
        )

    def predict(self, state: FloatArray, row_dt_s: float = 0.0, age_s: float = 0.0) -> PixelPrediction | None:
        """Return the pixel of the state (n,), or None if the target is behind the camera.

        ``row_dt_s`` is how long after the stamp the row is exposed, ``age_s`` how long clocks have drifted.
        """
        packed = self._geometry.packed
        if self._columns.size:
            change = np.zeros(CALIBRATION_SIZE)
            change[self._columns] = state[self._places]
            if change.any():
                packed = perturbed_packed(packed, change)
        pixel, H = np.empty(2), np.zeros((2, self._size))
        depth = self._at(packed, state, row_dt_s, age_s, pixel, H)
        if self._readout != _NOWHERE and depth >= kernels.MIN_DEPTH_M:
            # which row the target is on follows from the pixel itself
            share, longer = (pixel[1] + 0.5) / self._rows - 0.5, float(state[self._readout])
            if longer != 0.0:
                by_row = H[1] / self._rows
                H = np.zeros_like(H)
                depth = self._at(packed, state, row_dt_s + share * longer, age_s, pixel, H)
                H += longer * np.outer(self._speed(state, H), by_row)
            H[:, self._readout] = share * self._speed(state, H)
        return None if depth < kernels.MIN_DEPTH_M else PixelPrediction(pixel=pixel, jacobian=H, depth_m=depth)

    def _at(
        self, packed: FloatArray, state: FloatArray, dt_s: float, age_s: float, pixel: FloatArray, H: FloatArray
    ) -> float:
        """Fill pixel (2,) and H (2, n), zero before, for an exposure so long after the stamp; return the depth, m."""
        return float(_predict_pixel(packed, state, self._where, self._columns, self._places, dt_s, age_s, pixel, H))

    def _speed(self, state: FloatArray, H: FloatArray) -> FloatArray:
        """Return the pixel's own speed (2,) px/s: what it moves by where the exposure is later."""
        position, velocity, angles, rates = self._where[:4]
        speed = H[:, position : position + 3] @ state[velocity : velocity + 3]
        if angles != _NOWHERE:
            speed = speed + H[:, angles : angles + 2] @ state[rates : rates + 2]
        return np.asarray(speed)


@njit(cache=True)
def _predict_pixel(
    packed: FloatArray,
    x: FloatArray,
    where: IndexArray,
    columns: IndexArray,
    places: IndexArray,
    row_dt_s: float,
    age_s: float,
    pixel: FloatArray,
    H: FloatArray,
) -> float:
    """Fill the pixel (2,) and H (2, n), zero before; return the depth in m."""
    at, speed, angles, rates, offset, drift, ptu_offset, ptu_drift = where
    dt = row_dt_s
    if offset >= 0:
        dt += x[offset]
    if drift >= 0:
        dt += age_s * x[drift]
    head_dt = dt
    if ptu_offset >= 0:
        head_dt -= x[ptu_offset]
    if ptu_drift >= 0:
        head_dt -= age_s * x[ptu_drift]
    point = x[at : at + 3] + dt * x[speed : speed + 3]
    pan, tilt = 0.0, 0.0
    if angles >= 0:
        pan, tilt = x[angles] + head_dt * x[rates], x[angles + 1] + head_dt * x[rates + 1]
    jacobian, calibration = np.empty((2, 5)), np.empty((2, CALIBRATION_SIZE))
    if columns.size == 0:
        depth = kernels.project(packed, point, pan, tilt, pixel, jacobian)
    else:
        depth = project_calibration(packed, point, pan, tilt, pixel, jacobian, calibration)
    if depth < kernels.MIN_DEPTH_M:
        return depth
    for row in range(2):
        along, turning = 0.0, 0.0
        for k in range(3):
            H[row, at + k] = jacobian[row, k]
            H[row, speed + k] = dt * jacobian[row, k]
            along += jacobian[row, k] * x[speed + k]
        if angles >= 0:
            for k in range(2):
                H[row, angles + k] = jacobian[row, 3 + k]
                H[row, rates + k] = head_dt * jacobian[row, 3 + k]
                turning += jacobian[row, 3 + k] * x[rates + k]
        if offset >= 0:
            H[row, offset] = along + turning
        if drift >= 0:
            H[row, drift] = age_s * (along + turning)
        if ptu_offset >= 0:
            H[row, ptu_offset] = -turning
        if ptu_drift >= 0:
            H[row, ptu_drift] = -age_s * turning
        for k in range(columns.size):
            H[row, places[k]] = calibration[row, columns[k]]
    return depth


class EncoderModel:
    """One station's PTU: the angles that a reading should show, in the PTU's own clock."""

    def __init__(self, layout: StateLayout, station: str) -> None:
        self._layout = layout
        self._angles, self._rates = layout.angles[station], layout.rates[station]
        self.carries_clock = f"{station}.ptu_clock.offset" in layout.parameters

    def predict(self, state: FloatArray, ahead_s: float) -> LinearPrediction:
        """Return pan and tilt (2,) of a reading stamped ``ahead_s`` after the state's time."""
        H = np.zeros((2, self._layout.size))
        angle, rate = self._angles.start, self._rates.start
        H[0, angle] = H[1, angle + 1] = 1.0
        H[0, rate] = H[1, rate + 1] = ahead_s
        return LinearPrediction(value=state[self._angles] + ahead_s * state[self._rates], jacobian=H)

    def squares(
        self,
        state: FloatArray,
        P: FloatArray,
        angles_rad: tuple[float, float],
        ahead_s: float,
        variance_rad2: float,
        clock_sigma_s: float,
    ) -> float:
        """Return the squared sigmas of a reading, as `fuse` will find them."""
        expected = self.predict(state, ahead_s)
        residual = np.array([wrap_rad(a - b) for a, b in zip(angles_rad, expected.value, strict=True)])
        R = np.diag(variance_rad2 + (clock_sigma_s * state[self._rates]) ** 2)
        return float(squared_sigmas(residual, innovation_covariance(P, expected.jacobian, R)))

    def fuse(
        self,
        bank: ImmFilter,
        angles_rad: tuple[float, float],
        ahead_s: float,
        variance_rad2: float,
        clock_sigma_s: float,
        gate_sigma: float,
        estimated: BoolArray,
    ) -> Innovation:
        """Fuse a reading of pan and tilt, stamped ``ahead_s`` after the state's time, unless the gate refuses it.

        ``variance_rad2`` is the noise of each; ``clock_sigma_s`` counts as noise besides, in the measure of the rate.
        Both angles must be within ``gate_sigma``; the states that are ``estimated`` (n,) may move.
        """
        residual, S = np.empty(2), np.empty((2, 2))
        moved = bank.room()
        pan, tilt = angles_rad
        states, covariances = bank.modes()
        nis, accepted = _fuse_angles(
            states,
            covariances,
            bank.x,
            bank.P,
            bank.weights,
            self._angles.start,
            self._rates.start,
            pan,
            tilt,
            ahead_s,
            variance_rad2,
            clock_sigma_s,
            gate_sigma,
            estimated,
            residual,
            S,
            *moved,
        )
        if accepted:
            bank.take(moved)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)


@njit(cache=True)
def _fuse_angles(
    states: FloatArray,
    covariances: FloatArray,
    x: FloatArray,
    P: FloatArray,
    weights: FloatArray,
    angle: int,
    rate: int,
    pan_rad: float,
    tilt_rad: float,
    ahead_s: float,
    variance_rad2: float,
    clock_sigma_s: float,
    gate_sigma: float,
    estimated: BoolArray,
    residual: FloatArray,
    S: FloatArray,
    new_states: FloatArray,
    new_covariances: FloatArray,
    new_weights: FloatArray,
    new_x: FloatArray,
    new_P: FloatArray,
) -> tuple[float, bool]:
    """Write residual and S of a reading and, if it passes the gate, the modes after it; return its squared sigmas."""
    H, R = np.zeros((2, x.size)), np.zeros((2, 2))
    inside = True
    for k in range(2):
        H[k, angle + k], H[k, rate + k] = 1.0, ahead_s
        read = pan_rad if k == 0 else tilt_rad
        off = read - (x[angle + k] + ahead_s * x[rate + k])
        residual[k] = (off + np.pi) % (2.0 * np.pi) - np.pi
        R[k, k] = variance_rad2 + (clock_sigma_s * x[rate + k]) ** 2
    # S = H P Hᵀ + R of H = [I, ahead·I] at two pairs of places
    for a in range(2):
        for b in range(2):
            by_angle = P[angle + a, angle + b] + P[angle + a, rate + b] * ahead_s
            by_rate = P[rate + a, angle + b] + P[rate + a, rate + b] * ahead_s
            S[a, b] = R[a, b] + by_angle + ahead_s * by_rate
    for k in range(2):
        inside &= residual[k] ** 2 <= gate_sigma**2 * S[k, k]
    if inside:
        moved = (new_states, new_covariances, new_weights, new_x, new_P)
        correct_modes(states, covariances, x, weights, residual, H, R, estimated, 1.0, False, *moved)
    return squared_sigmas(residual, S), inside


class ReferenceModel:
    """A DGPS position: the target's own, shifted along its path by the clock's error, and by the antenna's place."""

    def __init__(self, layout: StateLayout) -> None:
        self._layout = layout
        self._offset = layout.parameters.get(f"{DGPS_CLOCK}.offset")
        self._drift = layout.parameters.get(f"{DGPS_CLOCK}.drift")
        known = [layout.parameters[name] for name in DGPS_ANTENNA if name in layout.parameters]
        self._antenna = known if len(known) == len(DGPS_ANTENNA) else None

    def predict(self, state: FloatArray, ahead_s: float, age_s: float = 0.0) -> LinearPrediction:
        """Return the position (3,) of a fix stamped ``ahead_s`` after the state's time."""
        dt = ahead_s
        if self._offset is not None:
            dt += float(state[self._offset])
        if self._drift is not None:
            dt += age_s * float(state[self._drift])
        velocity = state[self._layout.velocity]
        H = np.zeros((3, self._layout.size))
        H[:, self._layout.position] = np.eye(3)
        H[:, self._layout.velocity] = dt * np.eye(3)
        if self._offset is not None:
            H[:, self._offset] = velocity
        if self._drift is not None:
            H[:, self._drift] = age_s * velocity
        value = state[self._layout.position] + dt * velocity
        if self._antenna is not None:
            # how the body's axes turn with the velocity is left out: over a metre it is nothing
            H[:, self._antenna] = runway_from_body(velocity)
            value = value + H[:, self._antenna] @ state[self._antenna]
        return LinearPrediction(value=value, jacobian=H)

    def lateness_s(self, state: FloatArray, P: FloatArray, ahead_s: float, age_s: float = 0.0) -> tuple[float, float]:
        """Return how far in time a fix stamped ``ahead_s`` after now lies from now, and one sigma of that."""
        mean, variance = ahead_s, 0.0
        for place, lever in ((self._offset, 1.0), (self._drift, age_s)):
            if place is not None:
                mean += lever * float(state[place])
                variance += lever**2 * float(P[place, place])
        return mean, float(np.sqrt(variance))


def runway_from_body(velocity_m_s: FloatArray) -> FloatArray:
    """Return the body's axes (3, 3) as columns forward, right, down: along the velocity (3,), wings level."""
    level = float(np.hypot(velocity_m_s[0], velocity_m_s[1]))
    speed = float(np.hypot(level, velocity_m_s[2]))
    if level < 1e-6:
        return np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    forward = velocity_m_s / speed
    right = np.array([forward[1], -forward[0], 0.0]) * (speed / level)
    return np.column_stack([forward, right, np.cross(forward, right)])
