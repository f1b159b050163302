"""How a camera has turned from frame to frame, by the pictures alone: small windows of a scene that does not move."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from calibration.flight.observations import read_angles
from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import SessionError
from groundstation.geometry.station import StationGeometry
from groundstation.rig.rig import Station
from groundstation.session import Session
from groundstation.sources.frame_table import read_frames
from groundstation.sources.picture_reader import PictureReader

# frames further apart see another scene
MAX_PAIR_S = 0.5
_AROUND_S = 1.0
_CORNERS, _QUALITY, _APART_PX = 500, 0.003, 10
_GRID = (6, 5)
_MOST_IN_CELL = 14
# least number of windows and cells; in fewer, the observed motion may be that of the aircraft
_LEAST_WINDOWS, _LEAST_CELLS, _LEAST_COLUMNS = 16, 5, 3
_LEAST_TEXTURE = 4.0
_WINDOW, _LEVELS = (21, 21), 4
_FINE = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 0.005)
_BACK_PX = 0.4
_AGREE_SIGMAS, _LEAST_AGREE_PX, _AGREE_SHARE = 3.5, 0.25, 0.5
_ROUNDS = 4
_COARSE = 4
_TURN_RAD = 1e-5
# lower limit of a window's error in px, whatever their agreement
_FLOOR_PX = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageMotion:
    """Motion in n pairs of successive frames of one station.

    Attributes
    ----------
    from_s, to_s : (n,) mid-exposure of the windows in either frame, session time, corrected for a rolling shutter.
    turn_rad : (n, 2) change of pan and of tilt; ``sigma_rad`` (n, 2) one sigma from the agreement of the windows.
    frames : examined pairs; ``plain`` of these without enough texture, ``torn`` those with inconsistent windows.
    """

    from_s: FloatArray
    to_s: FloatArray
    turn_rad: FloatArray
    sigma_rad: FloatArray
    frames: int
    plain: int
    torn: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationMotion:
    """One station's readings (m, 3), session time in s and angles in rad as the rig has them, and its image motion."""

    station: Station
    readings: FloatArray
    motion: ImageMotion


def gather_motion(
    session: Session, from_s: float | None, to_s: float | None, progress: Callable[[int], None] = lambda _: None
) -> list[StationMotion]:
    """Read pictures and PTU readings of every turning station and measure how its pictures move.

    Raises `SessionError` where the session has no pictures, no turning station or no readings.
    """
    if session.detections_only:
        raise SessionError(
            str(session.folder), got="no pictures", wanted="videos or folders of pictures, with frames.csv"
        )
    turning = [s for s in session.rig.stations if not s.fixed]
    if not turning:
        raise SessionError(str(session.folder), got="fixed stations only", wanted="a station with a PTU")
    table = read_frames(session)
    if table.fault is not None:
        raise table.fault
    first, last = (-np.inf if from_s is None else from_s), (np.inf if to_s is None else to_s)
    found, done = [], 0
    for station in turning:
        stamps = table.stamps_s[station.name]
        chosen = np.isfinite(stamps) & (stamps >= first) & (stamps <= last)
        if chosen.sum() < 2:
            got = f"{int(chosen.sum())} frames of {station.name} in that time"
            raise SessionError(session.name, got=got, wanted="20 or more")
        t = stamps[chosen]
        readings = read_angles(session, float(t[0]) - _AROUND_S, float(t[-1]) + _AROUND_S)[station.name]
        if len(readings) < 2:
            got = f"{len(readings)} readings of its PTU"
            raise SessionError(f"station {station.name}", got=got, wanted="readings around the frames")
        medium, size = session.media[station.name], station.lens.image_size_px
        numbers = table.numbers[station.name]
        with PictureReader(medium, numbers[chosen], table.line[chosen], size, whole=False) as reader:

            def pictures(reader: PictureReader = reader) -> Iterator[ImageArray]:
                nonlocal done
                while (picture := reader.next()) is not None:
                    done += 1
                    progress(done)
                    yield picture.image

            motion = image_motion(station, t, readings, pictures())
        found.append(StationMotion(station=station, readings=readings, motion=motion))
    return found


def image_motion(
    station: Station, t_s: FloatArray, readings: FloatArray, pictures: Iterator[ImageArray]
) -> ImageMotion:
    """Measure the turns between successive pictures (h, w, 3), exposed at ``t_s`` (n,), session time.

    ``readings`` (m, 3): the encoders' angles only predict the position of a window in the next picture.
    """
    geometry = station.geometry()
    angles = np.column_stack([np.interp(t_s, readings[:, 0], np.unwrap(readings[:, k])) for k in (1, 2)])
    rows: list[tuple[float, ...]] = []
    pairs, plain, torn = 0, 0, 0
    greys = (np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8) for picture in pictures)
    for k, (before, grey) in enumerate(pairwise(greys), start=1):
        if t_s[k] - t_s[k - 1] <= MAX_PAIR_S:
            pairs += 1
            corners = _corners(before)
            if corners is None:
                plain += 1
            else:
                turn = _turn(_Pair(geometry, angles[k - 1], angles[k]), before, grey, corners)
                if turn is None:
                    torn += 1
                else:
                    rows.append(_row(station, t_s[k - 1], t_s[k], angles[k] - angles[k - 1], turn))
    values = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return ImageMotion(
        from_s=values[:, 0],
        to_s=values[:, 1],
        turn_rad=values[:, 2:4],
        sigma_rad=values[:, 4:6],
        frames=pairs,
        plain=plain,
        torn=torn,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Turn:
    """Residual turn in pan and tilt (2,) with sigmas (2,), rad; mean rows of the windows, parts of the height."""

    left_rad: FloatArray
    sigma_rad: FloatArray
    rows: tuple[float, float]


def _row(station: Station, from_s: float, to_s: float, encoder: FloatArray, turn: _Turn) -> tuple[float, ...]:
    exposed = (from_s + turn.rows[0] * station.readout_s, to_s + turn.rows[1] * station.readout_s)
    return (*exposed, *(encoder + turn.left_rad), *turn.sigma_rad)


def _corners(grey: ImageArray) -> FloatArray | None:
    """Return corners (n, 2) of the scene's texture, spread over the picture; None where there are too few."""
    found = cv2.goodFeaturesToTrack(grey, _CORNERS, _QUALITY, _APART_PX, blockSize=7)
    corners = np.zeros((0, 2)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 2)
    strength = cv2.cornerMinEigenVal(grey, 7, ksize=3)
    column, row = corners.astype(np.intp).T
    # Sobel's kernel over 7 x 7 pixels: about the square of the slope, grey levels per px
    corners = corners[np.sqrt(strength[row, column]) * 255.0 > _LEAST_TEXTURE]
    height, width = grey.shape
    cell = np.floor(corners / (width, height) * _GRID).astype(np.intp)
    number = cell[:, 0] * _GRID[1] + cell[:, 1]
    # the strongest come first
    kept = np.zeros(len(corners), dtype=np.bool_)
    for one in np.unique(number):
        kept[np.flatnonzero(number == one)[:_MOST_IN_CELL]] = True
    return corners[kept] if _spread(corners[kept], grey) else None


def _spread(corners: FloatArray, grey: ImageArray) -> bool:
    height, width = grey.shape
    cell = np.floor(corners / (width, height) * _GRID).astype(np.intp)
    cells = len(np.unique(cell[:, 0] * _GRID[1] + cell[:, 1]))
    columns = len(np.unique(cell[:, 0]))
    return len(corners) >= _LEAST_WINDOWS and cells >= _LEAST_CELLS and columns >= _LEAST_COLUMNS


class _Pair:
    """Two pairs of angles (2,) of one station: where a far point of the first picture falls in the second."""

    def __init__(self, geometry: StationGeometry, before: FloatArray, after: FloatArray) -> None:
        lens = geometry.lens
        self._matrix = np.array(
            [
                [lens.focal_px[0], 0, lens.principal_point_px[0]],
                [0, lens.focal_px[1], lens.principal_point_px[1]],
                [0, 0, 1],
            ]
        )
        self._distortion = lens.distortion
        self._geometry, self._after = geometry, after
        self._runway_from_before = geometry.camera_pose(*before.tolist()).runway_from_camera

    def predict(self, corners: FloatArray, left_rad: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of corners (n, 2), with ``left_rad`` (2,) added to the angles after."""
        plane = cv2.undistortPoints(corners[:, None], self._matrix, self._distortion).reshape(-1, 2)
        rays = np.column_stack([plane, np.ones(len(plane))])
        pan, tilt = self._after + left_rad
        after_from_before = self._geometry.camera_pose(pan, tilt).runway_from_camera.T @ self._runway_from_before
        turned = rays @ after_from_before.T
        pixels, _ = cv2.projectPoints(turned, np.zeros(3), np.zeros(3), self._matrix, self._distortion)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)

    def by_angle(self, corners: FloatArray, left_rad: FloatArray) -> FloatArray:
        """Return ∂pixel/∂(pan, tilt), (n, 2, 2)."""
        steps = [np.array([_TURN_RAD, 0.0]), np.array([0.0, _TURN_RAD])]
        columns = [self.predict(corners, left_rad + s) - self.predict(corners, left_rad - s) for s in steps]
        return np.stack(columns, axis=2) / (2.0 * _TURN_RAD)


def _turn(pair: _Pair, before: ImageArray, after: ImageArray, corners: FloatArray) -> _Turn | None:
    """Return the turn of the pictures beyond the readings; None where the windows are inconsistent."""
    left = np.zeros(2)
    for attempt in range(2):
        found = _tracked(pair, before, after, corners, left)
        if found is not None:
            return found
        if attempt == 0:
            coarse = _coarse(pair, before, after, corners)
            if coarse is None:
                return None
            left = coarse
    return None


def _coarse(pair: _Pair, before: ImageArray, after: ImageArray, corners: FloatArray) -> FloatArray | None:
    """Return the turn of the whole picture beyond the readings (2,), by phase correlation of small copies."""
    size = (before.shape[1] // _COARSE, before.shape[0] // _COARSE)
    old, new = (cv2.resize(p, size, interpolation=cv2.INTER_AREA).astype(np.float32) for p in (before, after))
    shift, answer = cv2.phaseCorrelate(old, new, cv2.createHanningWindow(size, cv2.CV_32F))
    if answer < 0.03:
        return None
    expected = np.median(pair.predict(corners, np.zeros(2)) - corners, axis=0)
    by_angle = np.median(pair.by_angle(corners, np.zeros(2)), axis=0)
    return np.asarray(np.linalg.solve(by_angle, _COARSE * np.array(shift) - expected))


def _tracked(pair: _Pair, before: ImageArray, after: ImageArray, corners: FloatArray, left: FloatArray) -> _Turn | None:
    guess = pair.predict(corners, left)
    height, width = before.shape
    inside = np.all((guess > 12) & (guess < (width - 13, height - 13)), axis=1)
    corners, guess = corners[inside], guess[inside]
    if not _spread(corners, before):
        return None
    start = np.ascontiguousarray(corners[:, None], dtype=np.float32)
    moved, good, _ = cv2.calcOpticalFlowPyrLK(
        *(before, after, start, np.ascontiguousarray(guess[:, None], dtype=np.float32)),
        winSize=_WINDOW,
        maxLevel=_LEVELS,
        criteria=_FINE,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    back, again, _ = cv2.calcOpticalFlowPyrLK(
        after,
        before,
        moved,
        start.copy(),
        winSize=_WINDOW,
        maxLevel=1,
        criteria=_FINE,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    same = np.linalg.norm((back - start).reshape(-1, 2), axis=1) < _BACK_PX
    kept = same & (good.ravel() == 1) & (again.ravel() == 1)
    corners, moved = corners[kept], np.asarray(moved, dtype=np.float64).reshape(-1, 2)[kept]
    if not _spread(corners, before):
        return None
    return _agreed(pair, corners, moved, before.shape)


def _agreed(pair: _Pair, corners: FloatArray, moved: FloatArray, shape: tuple[int, ...]) -> _Turn | None:
    """Return the turn that most windows agree on: of the median, then the mean of those near it."""
    left, step = np.zeros(2), np.zeros(2)
    agree = np.ones(len(corners), dtype=np.bool_)
    off, by_angle = np.zeros((0, 2)), np.zeros((0, 2, 2))
    for round_ in range(_ROUNDS):
        off = moved - pair.predict(corners, left)
        by_angle = pair.by_angle(corners, left)
        if round_ == 0:
            left = left + np.median(np.linalg.solve(by_angle, off[:, :, None])[:, :, 0], axis=0)
            continue
        length = np.linalg.norm(off, axis=1)
        limit = max(_LEAST_AGREE_PX, _AGREE_SIGMAS * float(np.median(length)) / 1.18)
        agree = length < limit
        if agree.mean() < _AGREE_SHARE or agree.sum() < _LEAST_WINDOWS:
            return None
        step = np.linalg.lstsq(by_angle[agree].reshape(-1, 2), off[agree].ravel(), rcond=None)[0]
        left = left + step
    columns = by_angle[agree].reshape(-1, 2)
    scatter = max(float(np.sqrt(np.mean((off[agree].ravel() - columns @ step) ** 2))), 1e-6)
    covariance = np.linalg.inv(columns.T @ columns)
    # neighbouring windows share the errors of the picture's coding: a lower limit that does not average out
    unit = np.linalg.inv(np.median(by_angle[agree], axis=0))
    sigma = np.sqrt(scatter**2 * np.diag(covariance) + _FLOOR_PX**2 * np.sum(unit**2, axis=1))
    rows = [float(np.mean(p[agree, 1] + 0.5) / shape[0] - 0.5) for p in (corners, moved)]
    return _Turn(left_rad=left, sigma_rad=sigma, rows=(rows[0], rows[1]))
