"""A camera on its pan-tilt unit as a least-squares problem: effect of each parameter on each sighting.

Parameters are differences from the initial station, in rad, m and without unit: those of
`groundstation.geometry.calibration` (``runway_from_base``, ``ptu_position``, ``head_from_camera``, ``camera_in_head``),
the fields of `groundstation.rig.ptu_axes.PtuAxes` without their unit (``lean``, ``pan_scale``, …), and for each mark
``mark NAME.part``.
Equations: docs/derivation.md, section 18.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache

import numpy as np

from calibration.flight.problem import about_rotated, left_jacobian
from calibration.mount.standstills import standstills
from groundstation.arrays import FloatArray, IntArray, MaskArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration_many
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.geometry.rotation import cross_matrices, rotation_from_vector
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import Station

AXES = ("pan_zero", "tilt_zero", "pan_scale", "tilt_scale", "lean", "pan_backlash", "tilt_backlash")
# errors that only sightings all over the range tell apart from the others
PERIODIC_AXES = ("pan_sine", "pan_cosine", "tilt_sag")
_FAR_M = 1e8
# sidereal rate of rotation (IERS conventions)
EARTH_RATE_RAD_S = 7.292115e-5
_LEAST_ALTITUDE_DEG = -1.0
# m, rad
_STEP_SCALES = {
    ".path": 1.0,
    "latency": 0.1,
    "mark": 0.01,
    "camera_in_head": 0.01,
    "ptu_position": 0.01,
    "scale": 1e-4,
    "focal": 10.0,
    "principal_point": 1.0,
    "distortion": 0.01,
}
_OTHER_STEP = 1e-3
_TURNS = (slice(0, 3), slice(6, 9))


class MarkKind(Enum):
    """Kinds of marks: known position, direction; stars; an aircraft; unknown point, direction or board."""

    POINT = "point"
    DIRECTION = "direction"
    SKY = "stars"
    PATH = "aircraft"
    UNKNOWN_POINT = "point of unknown place"
    UNKNOWN_DIRECTION = "direction, unknown"
    BOARD = "board of unknown place"

    @property
    def known(self) -> bool:
        """Whether it ties the station to the runway frame."""
        return self in (MarkKind.POINT, MarkKind.DIRECTION, MarkKind.SKY, MarkKind.PATH)


_PARTS = {
    MarkKind.POINT: ("x", "y", "z"),
    MarkKind.DIRECTION: ("across", "up"),
    MarkKind.SKY: ("clock", "refraction"),
    MarkKind.UNKNOWN_POINT: ("across", "up", "log_distance"),
    MarkKind.UNKNOWN_DIRECTION: ("across", "up"),
    MarkKind.BOARD: ("turn.x", "turn.y", "turn.z", "x", "y", "z"),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mark:
    """Something that does not move, as it is taken to stand.

    Attributes
    ----------
    place_m : (3,) runway frame; of a direction a unit vector; of a board its origin; of the sky the celestial pole.
    sigma : (3,) one sigma of each component of a known place (m) or direction (rad); of the sky, of the clock (s), of
        the refraction (share of it), and zero.
    runway_from_board : (3, 3), a board's only.
    """

    name: str
    kind: MarkKind
    place_m: FloatArray
    sigma: FloatArray
    runway_from_board: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(f"mark {self.name}.{part}" for part in _PARTS[self.kind])

    def points(self, change: FloatArray, station_m: FloatArray, body_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (n, 3), runway frame, and their derivatives (n, 3, k) for a change (k,) of its parameters.

        ``station_m`` (3,) is where the axes meet, ``body_m`` (n, 3) which points of a board; of the sky, the
        directions to the stars.
        """
        n = len(body_m)
        if self.kind is MarkKind.SKY:
            units, derivative = changed_sky(body_m, self.place_m, change)
            return station_m + _FAR_M * units, _FAR_M * derivative
        if self.kind is MarkKind.POINT:
            return _repeated(self.place_m + change, n), _repeated(np.eye(3), n)
        if self.kind is MarkKind.BOARD:
            turned = body_m @ (rotation_from_vector(change[:3]) @ self.runway_from_board).T
            derivative = np.zeros((n, 3, 6))
            derivative[:, :, 3:] = np.eye(3)
            # exp([θ]×) b moves by θ × b
            derivative[:, :, :3] = -cross_matrices(turned) @ left_jacobian(change[:3])
            return turned + self.place_m + change[3:], derivative
        if self.kind is MarkKind.UNKNOWN_POINT:
            away = self.place_m - station_m
            distance = float(np.linalg.norm(away))
            scale = distance * np.exp(change[2])
            unit, across = _direction(away / distance, change[:2])
            derivative = np.column_stack([scale * across, scale * unit])
            return _repeated(station_m + scale * unit, n), _repeated(derivative, n)
        unit, across = _direction(self.place_m, change[:2])
        return _repeated(station_m + _FAR_M * unit, n), _repeated(_FAR_M * across, n)


def changed_sky(units: FloatArray, pole: FloatArray, change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return directions to stars (n, 3), and derivatives (n, 3, 2), for a later clock, s, and more refraction, share.

    ``pole`` (3,) is the direction of the celestial north pole, which the sky turns about clockwise.
    """
    lifted = lift_by_refraction(units)
    derivative = np.stack([-EARTH_RATE_RAD_S * np.cross(pole, units), lifted], axis=2)
    changed = units + derivative @ change
    return changed / np.linalg.norm(changed, axis=1, keepdims=True), derivative


def lift_by_refraction(units: FloatArray) -> FloatArray:
    """Return by how much (n, 3) refraction of a standard atmosphere moves directions (n, 3), z up (Bennett 1982)."""
    up = np.clip(units[:, 2], -1.0, 1.0)
    altitude_deg = np.degrees(np.arcsin(up))
    seen_deg = np.maximum(altitude_deg, _LEAST_ALTITUDE_DEG)
    angle = np.radians(1.0 / 60.0) / np.tan(np.radians(seen_deg + 7.31 / (seen_deg + 4.4)))
    level = np.maximum(np.sqrt(1.0 - up**2), 1e-9)
    towards_zenith = np.column_stack([-units[:, 0] * up / level, -units[:, 1] * up / level, level])
    return np.asarray(angle[:, None] * towards_zenith)


def _repeated(one: FloatArray, n: int) -> FloatArray:
    """Return ``n`` times the same array."""
    return one[None].repeat(n, axis=0)


@lru_cache(maxsize=4096)
def _plane_across(unit: bytes) -> FloatArray:
    """Return two unit vectors (3, 2) across a unit vector (3,): the same in each step of a fit."""
    frame = np.linalg.svd(np.frombuffer(unit)[None])[2][1:].T
    frame.flags.writeable = False
    return np.asarray(frame)


def _direction(unit: FloatArray, change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a changed unit vector (3,) and its derivative (3, 2)."""
    frame = _plane_across(unit.tobytes())
    vector = unit + frame @ change
    length = float(np.linalg.norm(vector))
    changed = vector / length
    return changed, (np.eye(3) - np.outer(changed, changed)) @ frame / length


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountSightings:
    """Observations of one station, n sightings.

    Attributes
    ----------
    reading_rad : (n, 2) pan and tilt as read; ``sense`` (n, 2) the last direction of motion of each axis, +1, −1 or 0.
    pixel_px : (n, 2); ``sigma_px`` (n,) of u and of v.
    pointing : (n,) number of the reading: sightings of one share all of its errors.
    mark : (n,) number of the mark; ``body_m`` (n, 3) the point of a board, the direction to a star, otherwise zero.
    label : (n,) its origin, for the user.
    readings : (n,) how many readings ``reading_rad`` is the mean of; None: one.
    """

    reading_rad: FloatArray
    sense: FloatArray
    pixel_px: FloatArray
    sigma_px: FloatArray
    pointing: IntArray
    mark: IntArray
    body_m: FloatArray
    label: tuple[str, ...]
    readings: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.pixel_px)

    def keep(self, mask: MaskArray) -> "MountSightings":
        """Return the sightings of ``mask`` (n,)."""
        return MountSightings(
            reading_rad=self.reading_rad[mask],
            sense=self.sense[mask],
            pixel_px=self.pixel_px[mask],
            sigma_px=self.sigma_px[mask],
            pointing=self.pointing[mask],
            mark=self.mark[mask],
            body_m=self.body_m[mask],
            label=tuple(text for text, kept in zip(self.label, mask, strict=True) if kept),
            readings=None if self.readings is None else self.readings[mask],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedSightings:
    """Predicted pixels (n, 2), ``jacobian`` (n, 2, p), ``by_angle`` (n, 2, 2); ``usable`` (n,) which are in front."""

    pixel_px: FloatArray
    jacobian: FloatArray
    by_angle: FloatArray
    usable: MaskArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountProblem:
    """A station, its sightings, the marks, and p free parameters with prior sigmas (p,) (inf: no prior).

    ``stand`` (n,) numbers the standstills of the sightings, in which the error within an encoder's step is constant.
    ``places`` are the parameters' places in a change, ``of_marks`` the sightings of each mark and its own parameters,
    ``of_rig`` the places of those that the rig's geometry has, and where they stand in it.
    """

    station: Station
    sightings: MountSightings
    marks: tuple[Mark, ...]
    names: tuple[str, ...]
    prior_sigma: FloatArray
    stand: IntArray = field(init=False, repr=False)
    places: Mapping[str, int] = field(init=False, repr=False)
    of_marks: tuple[tuple[IntArray, tuple[str, ...]], ...] = field(init=False, repr=False)
    of_rig: tuple[IntArray, IntArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        seen = self.sightings
        object.__setattr__(self, "stand", standstills(seen.reading_rad, seen.sense, self.station))
        object.__setattr__(self, "places", {name: k for k, name in enumerate(self.names)})
        # a fit predicts hundreds of times
        of_marks = tuple((np.flatnonzero(seen.mark == n), mark.names) for n, mark in enumerate(self.marks))
        object.__setattr__(self, "of_marks", of_marks)
        own = [k for k, name in enumerate(self.names) if name in CALIBRATION_PARAMETERS]
        shorts = [CALIBRATION_PARAMETERS.index(self.names[k]) for k in own]
        object.__setattr__(self, "of_rig", (np.array(own, dtype=np.int64), np.array(shorts, dtype=np.int64)))

    @property
    def step_scale(self) -> FloatArray:
        """Typical steps (p,) of the parameters, for the trust region of the fit."""
        return np.array(
            [next((s for part, s in _STEP_SCALES.items() if part in name), _OTHER_STEP) for name in self.names]
        )

    def value(self, change: FloatArray, name: str) -> float:
        """Return one parameter of a change (p,); 0 where it is not free."""
        place = self.places.get(name)
        return 0.0 if place is None else float(change[place])

    def without(self, held: Sequence[str]) -> "MountProblem":
        """Return the problem with parameters held where they are."""
        keep = [k for k, name in enumerate(self.names) if name not in held]
        return replace(self, names=tuple(self.names[k] for k in keep), prior_sigma=self.prior_sigma[keep])

    def axes(self, change: FloatArray) -> PtuAxes:
        """Return the changed axes."""
        before = self.station.ptu_axes
        fields = {name: name if name.endswith("scale") else f"{name}_rad" for name in (*AXES, *PERIODIC_AXES)}
        return PtuAxes(**{f: float(getattr(before, f)) + self.value(change, n) for n, f in fields.items()})

    def station_at(self, change: FloatArray) -> Station:
        """Return the changed station."""
        full = np.zeros(CALIBRATION_SIZE)
        for k, name in enumerate(self.names):
            if name in CALIBRATION_PARAMETERS:
                full[CALIBRATION_PARAMETERS.index(name)] = change[k]
        return replace(self.station.changed(full), ptu_axes=self.axes(change))

    def predict(self, change: FloatArray) -> PredictedSightings:
        """Predict all sightings with a change (p,)."""
        seen, n = self.sightings, len(self.sightings)
        station = self.station_at(change)
        packed = station.geometry().packed
        axes = station.ptu_axes
        angles = axes.angles_many(seen.reading_rad, seen.sense)
        points, by_mark = np.zeros((n, 3)), []
        for mark, (own, names) in zip(self.marks, self.of_marks, strict=True):
            part = np.array([self.value(change, name) for name in names])
            points[own], derivative = mark.points(part, self.station.ptu_position_m, seen.body_m[own])
            if any(name in self.places for name in names):
                by_mark.append((own, names, derivative))
        pixel, by_state, by_rig = np.zeros((n, 2)), np.zeros((n, 2, 5)), np.zeros((n, 2, CALIBRATION_SIZE))
        depth = np.zeros(n)
        project_calibration_many(packed, points, angles, pixel, by_state, by_rig, depth)
        by_angle = by_state[:, :, 3:].copy()
        columns = self._axis_columns(by_angle, by_rig, angles[:, 1], station.camera_in_head_m)
        self._left(change, by_rig)
        jacobian = np.zeros((n, 2, len(self.names)))
        for name, column in columns.items():
            jacobian[:, :, self.places[name]] = column
        own, shorts = self.of_rig
        jacobian[:, :, own] = by_rig[:, :, shorts]
        for own, names, derivative in by_mark:
            moved = by_state[own][:, :, :3] @ derivative
            for part_number, name in enumerate(names):
                if name in self.places:
                    jacobian[own, :, self.places[name]] = moved[:, :, part_number]
        usable = depth > MIN_DEPTH_M
        jacobian[~usable], by_angle[~usable] = 0.0, 0.0
        return PredictedSightings(pixel_px=pixel, jacobian=jacobian, by_angle=by_angle, usable=usable)

    def _axis_columns(
        self, by_angle: FloatArray, by_rig: FloatArray, tilt: FloatArray, camera_m: FloatArray
    ) -> dict[str, FloatArray]:
        """Return ∂pixel/∂ of the errors of the axes that are sought, (n, 2) each."""
        reading, sense = self.sightings.reading_rad, self.sightings.sense
        by_pan, by_tilt = by_angle[:, :, 0], by_angle[:, :, 1]

        def lean() -> FloatArray:
            # it turns the head about Rx(tilt)ᵀ e_y; a boresight turns about the same axis, but not the lever arm
            axis = np.column_stack([np.zeros(len(tilt)), np.cos(tilt), -np.sin(tilt)])
            turned = np.einsum("nij,nj->ni", by_rig[:, :, 6:9], axis)
            return np.asarray(turned - np.einsum("nij,nj->ni", by_rig[:, :, 9:12], np.cross(camera_m, axis)))

        columns: dict[str, Callable[[], FloatArray]] = {
            "pan_zero": lambda: by_pan,
            "tilt_zero": lambda: by_tilt,
            "pan_scale": lambda: by_pan * reading[:, :1],
            "tilt_scale": lambda: by_tilt * reading[:, 1:],
            "lean": lean,
            "pan_backlash": lambda: -0.5 * by_pan * sense[:, :1],
            "tilt_backlash": lambda: -0.5 * by_tilt * sense[:, 1:],
            "pan_sine": lambda: by_pan * np.sin(reading[:, :1]),
            "pan_cosine": lambda: by_pan * (np.cos(reading[:, :1]) - 1.0),
            "tilt_sag": lambda: by_tilt * (1.0 - np.cos(reading[:, 1:])),
        }
        return {name: column() for name, column in columns.items() if name in self.places}

    def _left(self, change: FloatArray, by_rig: FloatArray) -> None:
        """Convert the kernel's small angles into those about the rotated frame."""
        full = np.array([self.value(change, name) for name in CALIBRATION_PARAMETERS])
        for part in _TURNS:
            by_rig[:, :, part] = about_rotated(by_rig[:, :, part], full[part])

    def covariance_px2(self, by_angle: FloatArray) -> FloatArray:
        """Return the covariance (n, 2, 2) of each sighting alone: pixel noise and that of its readings."""
        noise = self.sightings.sigma_px[:, None, None] ** 2 * np.eye(2)
        return np.asarray(noise + self.station.angle_sigma_rad**2 * by_angle @ np.swapaxes(by_angle, 1, 2))
