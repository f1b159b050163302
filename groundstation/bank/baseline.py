"""What a user would set up in an afternoon: CSRT started by hand, midpoint triangulation, a Kalman filter.

Each camera's tracker starts in the true bounding box of the first visible frame; the target point keeps its place in
the box. The filter is filterpy's, of constant velocity, fed with the midpoint of the rays and the covariance that one
pixel and the stated encoder noise give it there. It starts with the first midpoint, rejects nothing and coasts for
`COAST_S`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter

from groundstation.arrays import FloatArray
from groundstation.bank.csrt_process import CsrtProcess
from groundstation.bank.frame_outcomes import HIT_MARGIN_PX
from groundstation.bank.session_figures import RANGE_M
from groundstation.bank.session_truth import SessionTruth, distance_outside_px
from groundstation.box import Box
from groundstation.errors import SessionError
from groundstation.estimation.triangulation import midpoint
from groundstation.evaluation.bounds import StationView, fix_covariance, fix_information, motion_matrices
from groundstation.geometry.station import LensError, Ray
from groundstation.messages import Frame, PtuSample
from groundstation.rig.rig import Station
from groundstation.session import Truth, load_truth
from groundstation.sources.folder_source import FolderSource

PIXEL_SIGMA_PX = 1.0
COAST_S = 1.0
ACCELERATION_PSD_M2_S3 = (1.0, 1.0, 1.0)
_START_SPEED_SIGMA_M_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaselineTrack:
    """The Kalman filter's track: ``t_s`` (n,), ``position_m`` (n, 3), ``covariance_m2`` (n, 3, 3)."""

    t_s: FloatArray
    position_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixel:
    """A tracker's target point in one frame."""

    t_s: float
    u_px: float
    v_px: float


def baseline_row(truth: SessionTruth, python: Path) -> dict[str, float | None]:
    """Return the baseline's figures on a session, named ``baseline_…``; ``python`` has CSRT.

    Raises `InputError` where that Python has no CSRT, `SessionError` for a session without truth.
    """
    exact = load_truth(truth.session)
    if exact is None:
        raise SessionError(truth.session.name, got="no truth.csv", wanted="a rendered session with its truth")
    pixels = {name: _track_in(truth, name, exact, python) for name in truth.session.rig.names}
    hits, visible = 0, truth.visible_pairs()
    for name, found in pixels.items():
        for pair, pixel in found.items():
            frame = truth.frame(name, pair)
            if visible[name][pair] and frame is not None:
                point = np.array([pixel.u_px, pixel.v_px])
                hits += distance_outside_px(frame.silhouette, point) <= HIT_MARGIN_PX
    count = int(sum(mask.sum() for mask in visible.values()))
    track = _filter(truth, pixels)
    return {"baseline_hit_share": hits / count if count else None, **_errors(track, exact)}


def _track_in(truth: SessionTruth, station: str, exact: Truth, python: Path) -> dict[int, _Pixel]:
    """Return the tracker's target point by pair, from the first visible frame on."""
    found: dict[int, _Pixel] = {}
    part = np.array([0.5, 0.5])
    with CsrtProcess(python) as tracker, FolderSource(truth.session) as source:
        for event in source:
            if not isinstance(event, Frame) or event.station != station:
                continue
            image = event.image.whole()
            frame = truth.frame(station, event.epoch)
            box: Box[float] | None = None
            if not found:
                if frame is None or not frame.visible:
                    continue
                rows, columns = np.nonzero(frame.silhouette.mask)
                x, y = frame.silhouette.x + columns, frame.silhouette.y + rows
                box = Box(float(x.min()), float(y.min()), float(x.max() + 1), float(y.max() + 1))
                tracker.start(image, box)
                nose = _nose_pixel(exact, station, event.t_s)
                if nose is not None:
                    part = (nose - np.array([box.x0, box.y0])) / np.array(box.size)
            else:
                box = tracker.update(image)[1]
            if box is not None:
                u, v = np.array([box.x0, box.y0]) + part * np.array(box.size)
                found[event.epoch] = _Pixel(t_s=event.t_s, u_px=float(u), v_px=float(v))
    return found


def _nose_pixel(exact: Truth, station: str, t_s: float) -> FloatArray | None:
    """Return where the nose is in the frame of this time, (2,) px; None where it is not in view."""
    row = int(np.abs(exact.t_s - t_s).argmin())
    return exact.pixels_px[station][row] if exact.visible[station][row] else None


def _angles(truth: SessionTruth) -> dict[str, FloatArray]:
    """Return each station's readings as rows (t, pan, tilt), s and rad."""
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in truth.session.rig.names}
    with FolderSource(truth.session) as source:
        for event in source:
            if isinstance(event, PtuSample):
                rows[event.station].append((event.t_s, event.pan_rad, event.tilt_rad))
    return {name: np.array(found).reshape(-1, 3) for name, found in rows.items()}


def _filter(truth: SessionTruth, pixels: Mapping[str, Mapping[int, _Pixel]]) -> BaselineTrack:
    """Return the Kalman filter's track through the midpoints of each pair's rays."""
    angles, rig = _angles(truth), truth.session.rig
    filter_: KalmanFilter | None = None
    last_t = last_fix = 0.0
    t_s, positions, covariances = [], [], []
    for pair in sorted(set().union(*pixels.values())):
        views = [_view(rig[name], own[pair], angles[name]) for name, own in pixels.items() if pair in own]
        times = [own[pair].t_s for own in pixels.values() if pair in own]
        now = float(np.mean(times))
        fix = _fix([view for view in views if view is not None])
        if filter_ is None:
            if fix is None:
                continue
            filter_, last_t, last_fix = _started(*fix), now, now
        else:
            filter_.F, filter_.Q = motion_matrices(now - last_t, np.array(ACCELERATION_PSD_M2_S3))
            filter_.predict()
            last_t = now
            if fix is not None:
                filter_.update(fix[0], R=fix[1])
                last_fix = now
        if now - last_fix <= COAST_S:
            t_s.append(now)
            positions.append(np.asarray(filter_.x).ravel()[:3].copy())
            covariances.append(np.asarray(filter_.P)[:3, :3].copy())
    return BaselineTrack(
        t_s=np.array(t_s),
        position_m=np.array(positions).reshape(-1, 3),
        covariance_m2=np.array(covariances).reshape(-1, 3, 3),
    )


def _view(station: Station, pixel: _Pixel, angles: FloatArray) -> tuple[Ray, StationView] | None:
    """Return the ray of a pixel and what the bound needs of it; None where the lens has no ray or no angle is known."""
    pan = tilt = 0.0
    if not station.fixed:
        if len(angles) == 0:
            return None
        pan, tilt = (float(np.interp(pixel.t_s, angles[:, 0], angles[:, k])) for k in (1, 2))
    geometry = station.geometry()
    try:
        ray = geometry.ray(pixel.u_px, pixel.v_px, pan, tilt)
    except LensError:
        return None
    view = StationView(
        geometry=geometry,
        pan_rad=pan,
        tilt_rad=tilt,
        pixel_covariance_px2=PIXEL_SIGMA_PX**2 * np.eye(2),
        angle_sigma_rad=0.0 if station.fixed else station.angle_sigma_rad,
    )
    return ray, view


def _fix(seen: list[tuple[Ray, StationView]]) -> tuple[FloatArray, FloatArray] | None:
    """Return the midpoint (3,) of two or more rays with its covariance (3, 3)."""
    if len(seen) < 2:
        return None
    met = midpoint([ray for ray, _ in seen])
    if met is None:
        return None
    covariance = fix_covariance(fix_information(met[0], [view for _, view in seen]))
    return None if covariance is None else (met[0], covariance)


def _started(position_m: FloatArray, covariance_m2: FloatArray) -> KalmanFilter:
    started = KalmanFilter(dim_x=6, dim_z=3)
    started.x = np.concatenate([position_m, np.zeros(3)])
    started.P = np.zeros((6, 6))
    started.P[:3, :3] = covariance_m2
    started.P[3:, 3:] = _START_SPEED_SIGMA_M_S**2 * np.eye(3)
    started.H = np.eye(3, 6)
    return started


def _errors(track: BaselineTrack, exact: Truth) -> dict[str, float | None]:
    """Return the root mean square errors in `RANGE_M` and the ANEES of a track."""
    names = [f"baseline_near_rmse_{axis}_m" for axis in "xyz"]
    row: dict[str, float | None] = dict.fromkeys([*names, "baseline_coverage", "baseline_anees"])
    inside = (track.t_s >= exact.t_s[0]) & (track.t_s <= exact.t_s[-1])
    row["baseline_coverage"] = float(inside.sum() / len(exact.t_s))
    if not inside.any():
        return row
    true = np.stack([np.interp(track.t_s[inside], exact.t_s, exact.position_runway_m[:, k]) for k in range(3)], axis=1)
    error, covariance = track.position_m[inside] - true, track.covariance_m2[inside]
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])
    row["baseline_anees"] = float(nees.mean() / 3.0)
    near = (true[:, 1] >= RANGE_M[0]) & (true[:, 1] < RANGE_M[1])
    if near.any():
        rms = np.sqrt((error[near] ** 2).mean(axis=0))
        row |= dict(zip(names, rms.tolist(), strict=True))
    return row
