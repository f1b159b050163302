"""Baseline of standard methods: CSRT with manual initialisation, midpoint triangulation, a Kalman filter.

Each camera's tracker starts in the true bounding box of the first visible frame; the target point keeps its place in
the box. The filter is filterpy's, of constant velocity, fed with the midpoint of the rays and the covariance that one
pixel and the stated encoder noise give it there. It starts with the first midpoint, rejects nothing and coasts for
`COAST_S`.
"""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter

from groundstation.arrays import FloatArray, MaskArray
from groundstation.bank.csrt_process import CsrtProcess
from groundstation.bank.frame_outcomes import HIT_MARGIN_PX
from groundstation.bank.session_figures import RANGE_M
from groundstation.bank.session_truth import FrameSilhouette, SessionTruth, distance_outside_px
from groundstation.box import Box
from groundstation.errors import SessionError
from groundstation.estimation.triangulation import midpoint
from groundstation.evaluation.bounds import StationView, fix_covariance, fix_information, motion_matrices
from groundstation.evaluation.position_series import IndexArray
from groundstation.geometry.station import LensError, Ray
from groundstation.messages import Frame, PtuSample
from groundstation.rig.rig import Station
from groundstation.session import Truth, load_truth
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.true_silhouettes import TrueSilhouette

PIXEL_SIGMA_PX = 1.0
# OpenCV 4's CSRT ends with an error in boxes of a few rows, as of a wing seen from ahead
LEAST_BOX_PX = 8.0
COAST_S = 1.0
ACCELERATION_PSD_M2_S3 = (1.0, 1.0, 1.0)
_START_SPEED_SIGMA_M_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaselineTrack:
    """The Kalman filter's track: ``pairs`` (n,), ``t_s`` (n,), ``position_m`` (n, 3), ``covariance_m2`` (n, 3, 3)."""

    pairs: IndexArray
    t_s: FloatArray
    position_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixel:
    """A tracker's target point in one frame."""

    t_s: float
    u_px: float
    v_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _TrackedSession:
    """Target points by station and pair, and each station's readings as rows (t, pan, tilt), s and rad."""

    pixels: Mapping[str, Mapping[int, _Pixel]]
    angles: Mapping[str, FloatArray]


def baseline_row(truth: SessionTruth, python: Path) -> dict[str, float | None]:
    """Return the baseline's figures on a session, named ``baseline_…``; ``python`` has CSRT.

    Raises `InputError` where that Python has no CSRT, `SessionError` for a session without truth.
    """
    exact = load_truth(truth.session)
    if exact is None:
        raise SessionError(truth.session.name, got="no truth.csv", wanted="a rendered session with its truth")
    recording = _track(truth, exact, python)
    hits, visible = 0, truth.visible_pairs()
    for name, found in recording.pixels.items():
        for pair, pixel in found.items():
            frame = truth.frame(name, pair)
            if visible[name][pair] and frame is not None:
                point = np.array([pixel.u_px, pixel.v_px])
                hits += distance_outside_px(frame.silhouette, point) <= HIT_MARGIN_PX
    count = int(sum(mask.sum() for mask in visible.values()))
    track = _filter(truth, recording)
    seen_by_two = np.sum(list(visible.values()), axis=0) >= 2
    return {
        "baseline_hit_share": hits / count if count else None,
        "baseline_coverage": coverage_of(track.pairs, seen_by_two),
        **_errors(track, exact),
    }


def coverage_of(estimated: IndexArray, seen_by_two: MaskArray) -> float | None:
    """Return the share of the pairs with an estimate, counted as the program's own coverage is.

    That is from the first of the ``estimated`` (m,), numbers of pairs, to the last that two cameras see, of (n,): 0
    where nothing is estimated until then, None where two cameras never see the aircraft.
    """
    seen = np.flatnonzero(seen_by_two)
    if not len(seen):
        return None
    if not len(estimated) or estimated[0] > seen[-1]:
        return 0.0
    return float(np.count_nonzero(estimated <= seen[-1]) / (seen[-1] - estimated[0] + 1))


def _track(truth: SessionTruth, exact: Truth, python: Path) -> _TrackedSession:
    """Return what one tracker for each station finds from the first visible frame on, in one pass over the session."""
    pixels: dict[str, dict[int, _Pixel]] = {name: {} for name in truth.session.rig.names}
    angles: dict[str, list[tuple[float, float, float]]] = {name: [] for name in pixels}
    with ExitStack() as opened:
        trackers = {name: _StationTracker(opened.enter_context(CsrtProcess(python))) for name in pixels}
        for event in opened.enter_context(FolderSource(truth.session)):
            if isinstance(event, PtuSample):
                angles[event.station].append((event.t_s, event.pan_rad, event.tilt_rad))
            elif isinstance(event, Frame):
                nose = nose_pixel(exact, event.station, event.t_s)
                point = trackers[event.station].point(event, truth.frame(event.station, event.epoch), nose)
                if point is not None:
                    u, v = point.tolist()
                    pixels[event.station][event.epoch] = _Pixel(t_s=event.t_s, u_px=u, v_px=v)
    return _TrackedSession(pixels=pixels, angles={name: np.array(rows).reshape(-1, 3) for name, rows in angles.items()})


class _StationTracker:
    """One camera's tracker; the target point keeps its ``part`` of the box, where the nose is at the start."""

    def __init__(self, csrt: CsrtProcess) -> None:
        self._csrt = csrt
        self._part = np.array([0.5, 0.5])
        self._begun = False

    def point(self, frame: Frame, there: FrameSilhouette | None, nose_px: FloatArray | None) -> FloatArray | None:
        """Return the target point (2,) px in the next frame; None before the first visible one and where it is lost."""
        image = frame.image.whole()
        if self._begun:
            box = self._csrt.update(image)[1]
            return None if box is None else np.array([box.x0, box.y0]) + self._part * np.array(box.size)
        if there is None or not there.visible:
            return None
        start = start_box(there.silhouette)
        self._csrt.start(image, start)
        self._begun = True
        corner, size = np.array([start.x0, start.y0]), np.array(start.size)
        if nose_px is not None:
            self._part = (nose_px - corner) / size
        return corner + self._part * size


def start_box(silhouette: TrueSilhouette) -> Box[float]:
    """Return the box of a silhouette, px, in each direction at least `LEAST_BOX_PX` about its middle."""
    rows, columns = np.nonzero(silhouette.mask)
    low = np.array([silhouette.x + columns.min(), silhouette.y + rows.min()], dtype=np.float64)
    high = np.array([silhouette.x + columns.max() + 1, silhouette.y + rows.max() + 1], dtype=np.float64)
    grown = np.maximum(0.5 * (LEAST_BOX_PX - (high - low)), 0.0)
    (x0, y0), (x1, y1) = (low - grown).tolist(), (high + grown).tolist()
    return Box(x0, y0, x1, y1)


def nose_pixel(exact: Truth, station: str, t_s: float) -> FloatArray | None:
    """Return where the nose is in the frame of this time, (2,) px; None where it is not in view."""
    row = int(np.abs(exact.t_s - t_s).argmin())
    return exact.pixels_px[station][row] if exact.visible[station][row] else None


def _filter(truth: SessionTruth, recording: _TrackedSession) -> BaselineTrack:
    """Return the Kalman filter's track through the midpoints of each pair's rays."""
    pixels, angles, rig = recording.pixels, recording.angles, truth.session.rig
    filter_: KalmanFilter | None = None
    last_t = last_fix = 0.0
    held, t_s, positions, covariances = [], [], [], []
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
            held.append(pair)
            t_s.append(now)
            positions.append(np.asarray(filter_.x).ravel()[:3].copy())
            covariances.append(np.asarray(filter_.P)[:3, :3].copy())
    return BaselineTrack(
        pairs=np.array(held, dtype=np.intp),
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
    row: dict[str, float | None] = dict.fromkeys([*names, "baseline_anees"])
    inside = (track.t_s >= exact.t_s[0]) & (track.t_s <= exact.t_s[-1])
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
