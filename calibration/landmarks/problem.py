"""Stations and landmarks as one least-squares problem, a bundle adjustment (docs/derivation.md, section 17).

A parameter is a difference from the rig or from the table of landmarks, in rad, m, px. Names are
``station.parameter`` as in `groundstation.geometry.calibration`; ``station.moved.x .y .z``, by which small rotation
the base (runway frame), or the camera on its head (head frame), has turned since; ``landmark NAME.x .y .z``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.flight.problem import about_rotated
from calibration.landmarks.angles import LandmarkObservations
from calibration.sightings import Landmark
from groundstation.arrays import FloatArray, IntArray, MaskArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, perturbed_packed
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration_many
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Station

AXES = ("x", "y", "z")
# a direction is a point so far away that a lever arm turns it by nothing
FAR_M = 1e8
# so much a knock may be; an axis that the landmarks do not show stays where it was
MOVED_SIGMA_RAD = float(np.radians(1.0))
# of what nothing is known: a step of the solver, rad or m
_SCALES = {"runway_from_base": 1e-3, "ptu_position": 0.1}
_LEAST_SHARE = 1e-12
_TURNS = (slice(0, 3), slice(6, 9))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearisedSightings:
    """Predicted pixels (n, 2) of all observations, ``jacobian`` (n, 2, q) by the unknowns, ``by_angle`` (n, 2, 2)."""

    pixel_px: FloatArray
    jacobian: FloatArray
    by_angle: FloatArray
    usable: MaskArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LandmarkRows:
    """A landmark's number, a station's rows (k,) that are of it, and its places among the parameters, if any."""

    number: int
    rows: IntArray
    places: list[int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ObservationLayout:
    """Where the parameters that a station's observations depend on stand: a fit predicts thousands of times.

    ``places`` (k,) of the station's own ones, ``shorts`` (k,) where among `CALIBRATION_PARAMETERS`; ``moved`` (0 or 3,)
    of its rotation since. ``far`` (n,) observations of a direction.
    """

    places: IntArray
    shorts: IntArray
    moved: IntArray
    landmarks: tuple[_LandmarkRows, ...]
    far: MaskArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkProblem:
    """The observations, and the dependence of p parameters on q unknowns.

    Attributes
    ----------
    names : (p,) of the parameters.
    spread : (p, q) a change is spread · unknowns.
    known : (q,) unknowns with a standard normal prior; the others have none.
    slipped : stations whose camera has turned on its head, rather than the base.
    """

    stations: Mapping[str, Station]
    observations: tuple[LandmarkObservations, ...]
    landmarks: tuple[Landmark, ...]
    names: tuple[str, ...]
    spread: FloatArray
    known: MaskArray
    slipped: frozenset[str] = frozenset()
    _packed: Mapping[str, FloatArray] = field(init=False, repr=False)
    _numbers: Mapping[str, int] = field(init=False, repr=False)
    _layouts: tuple[_ObservationLayout, ...] = field(init=False, repr=False)
    _newest: dict[bytes, LinearisedSightings] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        packed = {name: station.geometry().packed for name, station in self.stations.items()}
        object.__setattr__(self, "_packed", packed)
        object.__setattr__(self, "_numbers", {name: k for k, name in enumerate(self.names)})
        object.__setattr__(self, "_layouts", tuple(self._layout(observed) for observed in self.observations))

    @property
    def pixel_px(self) -> FloatArray:
        """All observations' pixels (n, 2)."""
        return np.concatenate([observed.pixel_px for observed in self.observations])

    @property
    def variances(self) -> tuple[FloatArray, FloatArray]:
        """All observations' variances (n,) of a pixel's axis, px², and of an angle, rad²."""
        return (
            np.concatenate([observed.pixel_variance for observed in self.observations]),
            np.concatenate([observed.angle_variance for observed in self.observations]),
        )

    def places(self, group: str) -> list[int]:
        """Return where the three parameters ``group``.x .y .z stand; fewer where they are not uncertain."""
        numbers = (self._numbers.get(f"{group}.{axis}") for axis in AXES)
        return [k for k in numbers if k is not None]

    def own(self, station: str) -> list[tuple[int, int]]:
        """Return (place, place among `CALIBRATION_PARAMETERS`) of a station's own parameters."""
        return [
            (k, CALIBRATION_PARAMETERS.index(short))
            for k, name in enumerate(self.names)
            for owner, _, short in (name.partition("."),)
            if owner == station and short in CALIBRATION_PARAMETERS
        ]

    def station_change(self, change: FloatArray, station: str, *, today: bool) -> FloatArray:
        """Return one station's change (21,) out of a change (p,) of all parameters."""
        own = np.zeros(CALIBRATION_SIZE)
        for place, there in self.own(station):
            own[there] = change[place]
        if today:
            first = self.moved_from(station)
            moved = self.places(f"{station}.moved")
            own[first : first + len(moved)] += change[moved]
        return own

    def moved_from(self, station: str) -> int:
        """Return where the rotation that ``moved`` adds to stands among `CALIBRATION_PARAMETERS`."""
        return CALIBRATION_PARAMETERS.index("head_from_camera.x" if station in self.slipped else "runway_from_base.x")

    def evaluate(self, unknowns: FloatArray) -> LinearisedSightings:
        """Predict all observations' pixels at unknowns (q,)."""
        at = unknowns.tobytes()
        # a solver requests residuals, slopes and noise at one point
        if at not in self._newest:
            self._newest.clear()
            self._newest[at] = self._evaluate(self.spread @ unknowns)
        return self._newest[at]

    def _layout(self, observed: LandmarkObservations) -> _ObservationLayout:
        own = self.own(observed.station)
        numbers = np.unique(observed.landmark)
        return _ObservationLayout(
            places=np.array([place for place, _ in own], dtype=np.int64),
            shorts=np.array([there for _, there in own], dtype=np.int64),
            moved=np.array(self.places(f"{observed.station}.moved") if observed.today else [], dtype=np.int64),
            landmarks=tuple(
                _LandmarkRows(
                    number=int(k),
                    rows=np.flatnonzero(observed.landmark == k),
                    places=self.places(f"landmark {self.landmarks[k].name}"),
                )
                for k in numbers
            ),
            far=np.isin(observed.landmark, [k for k in numbers if self.landmarks[k].kind == "direction"]),
        )

    def _evaluate(self, change: FloatArray) -> LinearisedSightings:
        both = zip(self.observations, self._layouts, strict=True)
        parts = [self._predict(observed, layout, change) for observed, layout in both]
        return LinearisedSightings(
            pixel_px=np.concatenate([p.pixel_px for p in parts]),
            jacobian=np.concatenate([p.jacobian for p in parts]),
            by_angle=np.concatenate([p.by_angle for p in parts]),
            usable=np.concatenate([p.usable for p in parts]),
        )

    def _predict(
        self, observed: LandmarkObservations, layout: _ObservationLayout, change: FloatArray
    ) -> LinearisedSightings:
        n, first = len(observed), self.moved_from(observed.station)
        own = np.zeros(CALIBRATION_SIZE)
        own[layout.shorts] = change[layout.places]
        own[first : first + len(layout.moved)] += change[layout.moved]
        packed = perturbed_packed(self._packed[observed.station], own)
        points, by_places = np.zeros((n, 3)), []
        for one in layout.landmarks:
            points[one.rows], by_place = self._point(one.number, one.places, change, packed[9:12])
            by_places.append(by_place)
        pixel, by_state = np.zeros((n, 2)), np.zeros((n, 2, 5))
        by_rig, depth = np.zeros((n, 2, CALIBRATION_SIZE)), np.zeros(n)
        project_calibration_many(packed, points, observed.angles_rad, pixel, by_state, by_rig, depth)
        by_rig[layout.far, :, 3:6] = 0.0
        for part in _TURNS:
            by_rig[:, :, part] = about_rotated(by_rig[:, :, part], own[part])
        jacobian = np.zeros((n, 2, len(self.names)))
        jacobian[:, :, layout.places] = by_rig[:, :, layout.shorts]
        jacobian[:, :, layout.moved] = by_rig[:, :, first : first + len(layout.moved)]
        for one, by_place in zip(layout.landmarks, by_places, strict=True):
            if one.places:
                jacobian[one.rows, :, one.places[0] : one.places[0] + 3] = by_state[one.rows, :, :3] @ by_place
        usable = depth > MIN_DEPTH_M
        jacobian[~usable] = 0.0
        # as one product of matrices: as many as there are sightings take three times as long (of 300)
        by_unknown = (jacobian.reshape(2 * n, -1) @ self.spread).reshape(n, 2, -1)
        return LinearisedSightings(pixel_px=pixel, jacobian=by_unknown, by_angle=by_state[:, :, 3:], usable=usable)

    def _point(
        self, k: int, places: list[int], change: FloatArray, position_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return a landmark as a point (3,) and what its components (3, 3) do to it."""
        landmark = self.landmarks[k]
        place = np.array(landmark.place, dtype=np.float64)
        if places:
            place = place + change[places]
        if landmark.kind == "point":
            return place, np.eye(3)
        length = float(np.linalg.norm(place))
        unit = place / length
        return position_m + FAR_M * unit, FAR_M / length * (np.eye(3) - np.outer(unit, unit))


def pose_problem(
    stations: Mapping[str, Station],
    observed: Sequence[LandmarkObservations],
    landmarks: Sequence[Landmark],
    free: Sequence[str],
    before: ParameterCovariance,
    moved: Sequence[str] = (),
    slipped: frozenset[str] = frozenset(),
) -> LandmarkProblem:
    """Return the problem of estimating ``free`` parameters without a prior, and the rest within ``before``.

    ``before`` is a joint covariance of ``station.parameter``; its part of ``free`` ones is not used. Landmarks are
    uncertain by their own sigmas. Stations of ``moved`` may have turned by `MOVED_SIGMA_RAD` between them, those of
    ``slipped`` not with their base but with the camera on the head.
    """
    blocks: list[tuple[tuple[str, ...], FloatArray, bool]] = []
    for name in free:
        scale = next((value for part, value in _SCALES.items() if part in name), 1.0)
        blocks.append(((name,), np.array([[scale]]), False))
    for name in moved:
        blocks += [((f"{name}.moved.{axis}",), np.array([[MOVED_SIGMA_RAD]]), True) for axis in AXES]
    # landmarks stand still: the covariance of the clocks takes no part
    stated = {f"{station}.{short}" for station in stations for short in CALIBRATION_PARAMETERS}.difference(free)
    rest = [k for k, name in enumerate(before.names) if name in stated]
    if rest:
        names = tuple(before.names[k] for k in rest)
        blocks.append((names, root_of(before.matrix[np.ix_(rest, rest)]), True))
    for landmark in landmarks:
        for axis, sigma in zip(AXES, landmark.sigma, strict=True):
            # of all three or of none, so that a landmark's place is one vector
            if landmark.sigma.any():
                blocks.append(((f"landmark {landmark.name}.{axis}",), np.array([[sigma]]), True))
    spread = np.zeros((sum(b[1].shape[0] for b in blocks), sum(b[1].shape[1] for b in blocks)))
    row = column = 0
    known: list[bool] = []
    for _, root, is_known in blocks:
        h, w = root.shape
        spread[row : row + h, column : column + w] = root
        row, column = row + h, column + w
        known += [is_known] * w
    return LandmarkProblem(
        stations=dict(stations),
        observations=tuple(observed),
        landmarks=tuple(landmarks),
        names=tuple(name for names, _, _ in blocks for name in names),
        spread=spread,
        known=np.array(known, dtype=np.bool_),
        slipped=slipped,
    )


def root_of(covariance: FloatArray) -> FloatArray:
    """Return R (n, k) with R Rᵀ the covariance (n, n); k is smaller than n where that is singular."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    keep = values > _LEAST_SHARE * max(float(values.max()), _LEAST_SHARE)
    return np.asarray(scale[:, None] * vectors[:, keep] * np.sqrt(values[keep]))
