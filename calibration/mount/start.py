"""Initial values of a mount: all possible rotations of the camera about its axis are tried."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.mount.problem import Mark, MarkKind, MountSightings
from calibration.orientation import bearings_in_base, find_orientation
from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_y, wxyz_from_matrix
from groundstation.rig.rig import Station

_QUARTERS_RAD = tuple(np.radians(a) for a in (0.0, 90.0, 180.0, 270.0))
# largest misfit of the marks at which a rig's own orientation is used
_NEAR_RAD = float(np.radians(3.0))
_FAR_M = 1e6
_LEAST_KNOWN = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountStart:
    """A station and its marks as one may start from; ``miss_rad`` is the median angle by which bearings miss."""

    station: Station
    marks: tuple[Mark, ...]
    miss_rad: float


def mount_starts(station: Station, seen: MountSightings, marks: Sequence[Mark]) -> list[MountStart]:
    """Return starts, the best first: the rig's own orientation, and others where that is not known or misses."""
    tried = (_start(station, seen, marks, turned=turned) for turned in (False, True))
    own = [start for start in tried if start is not None]
    best = min((s.miss_rad for s in own), default=np.inf)
    if "orientation" in station.known and best < _NEAR_RAD:
        return _with_boards(own, seen, marks)
    starts: list[MountStart] = []
    for quarter in _QUARTERS_RAD:
        # the axis of an ideal camera is the head's y; rotations about it, as a camera may be mounted
        head_from_camera = rotation_y(quarter) @ rotation_x(-0.5 * np.pi)
        camera = replace(station, head_from_camera_wxyz=wxyz_from_matrix(head_from_camera))
        either = (_start(camera, seen, marks, turned=turned) for turned in (True, False))
        starts += [start for start in either if start is not None]
    found = sorted([*own, *starts], key=lambda s: s.miss_rad)
    return _with_boards(found[:3], seen, marks)


def _start(station: Station, seen: MountSightings, marks: Sequence[Mark], turned: bool) -> MountStart | None:
    """Return a start with the camera as it is; ``turned`` with the base turned until known marks fit."""
    geometry = replace(station, runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0])).geometry()
    angles = station.ptu_axes.angles_many(seen.reading_rad, seen.sense)
    bearings = bearings_in_base(geometry, seen.pixel_px, angles)
    good = np.isfinite(bearings).all(axis=1)
    towards = np.full((len(seen), 3), np.nan)
    for number, mark in enumerate(marks):
        if mark.kind.known:
            away = mark.place_m - station.ptu_position_m if mark.kind is MarkKind.POINT else mark.place_m
            towards[seen.mark == number] = away / np.linalg.norm(away)
    known = good & np.isfinite(towards).all(axis=1)
    base = matrix_from_wxyz(station.runway_from_base_wxyz)
    if turned:
        if len(set(seen.mark[known].tolist())) < _LEAST_KNOWN:
            return None
        points = station.ptu_position_m + _FAR_M * towards[known]
        base = find_orientation(bearings[known], points, station.ptu_position_m).runway_from_base
    looking = bearings @ base.T
    placed, misses = [], []
    for number, mark in enumerate(marks):
        own = good & (seen.mark == number)
        if mark.kind in (MarkKind.UNKNOWN_POINT, MarkKind.UNKNOWN_DIRECTION) and own.any():
            middle = np.median(looking[own], axis=0)
            middle /= np.linalg.norm(middle)
            far = np.linalg.norm(mark.place_m) if mark.kind is MarkKind.UNKNOWN_POINT else 1.0
            at = station.ptu_position_m if mark.kind is MarkKind.UNKNOWN_POINT else np.zeros(3)
            placed.append(replace(mark, place_m=at + far * middle))
            towards[own] = middle
        else:
            placed.append(mark)
    has = good & np.isfinite(towards).all(axis=1)
    misses = np.linalg.norm(looking[has] - towards[has], axis=1)
    tried = replace(station, runway_from_base_wxyz=wxyz_from_matrix(base))
    miss = float(np.median(misses)) if len(misses) else 0.0
    return MountStart(station=tried, marks=tuple(placed), miss_rad=miss)


def _with_boards(starts: list[MountStart], seen: MountSightings, marks: Sequence[Mark]) -> list[MountStart]:
    """Return the starts, one for each of the two possible poses of a flat board."""
    for number, mark in enumerate(marks):
        if mark.kind is not MarkKind.BOARD:
            continue
        placed = []
        for start in starts:
            poses = [_board(start.station, seen, number, way) for way in (0, 1)]
            for rotation, origin in (pose for pose in poses if pose is not None):
                board = replace(mark, place_m=origin, runway_from_board=rotation)
                others = tuple(board if k == number else other for k, other in enumerate(start.marks))
                placed.append(replace(start, marks=others))
        starts = placed or starts
    return starts


def _board(station: Station, seen: MountSightings, number: int, way: int) -> tuple[FloatArray, FloatArray] | None:
    """Return a board's rotation (3, 3) and origin (3,), runway frame, from the picture with most of its corners."""
    own = np.flatnonzero(seen.mark == number)
    pointings, counts = np.unique(seen.pointing[own], return_counts=True)
    best = own[seen.pointing[own] == pointings[int(np.argmax(counts))]]
    if len(best) < 4:
        return None
    fx, fy = station.lens.focal_px
    matrix = np.array([[fx, 0.0, station.lens.principal_point_px[0]], [0.0, fy, station.lens.principal_point_px[1]]])
    matrix = np.vstack([matrix, [0.0, 0.0, 1.0]])
    found, turns, shifts, _ = cv2.solvePnPGeneric(
        seen.body_m[best], seen.pixel_px[best], matrix, station.lens.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if found <= way:
        return None
    angles = station.ptu_axes.angles(*seen.reading_rad[best[0]].tolist(), *seen.sense[best[0]].tolist())
    pose = station.geometry().camera_pose(*angles)
    rotation = pose.runway_from_camera @ cv2.Rodrigues(turns[way])[0]
    origin = pose.position_runway_m + pose.runway_from_camera @ np.asarray(shifts[way]).ravel()
    return rotation, origin
