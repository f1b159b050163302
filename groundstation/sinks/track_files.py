"""The result files of a replay: track.csv, triangulation.csv, detections.csv and track.tum, written incrementally.

Only complete lines are flushed, so that the files of a killed run are readable to their last epoch; `write` may be
followed by `flush` where the disk was full and is no longer. Rows of a search, and of
a track that is not confirmed, are kept in memory for five seconds at most: a frame without a target gets the pixel by
which one was found afterwards, and one of a track that was displaced before it was confirmed loses its pixel.
A missing value is an empty cell.
"""

import math
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.evaluation.unconfirmed_rows import UnconfirmedRows
from groundstation.files.line_file import LineFile
from groundstation.files.whole_file import whole_file
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    InitialPixel,
    StepReport,
    TrackEstimate,
    TriangulationStatus,
)

TRACK_COLUMNS = (
    *("t_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"),
    *("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2", "status"),
)
TRIANGULATION_COLUMNS = ("t_s", "x_m", "y_m", "z_m", "status")
DETECTION_COLUMNS = (
    *("t_s", "station", "u_px", "v_px", "sigma_u_px", "sigma_v_px"),
    *("roi_x_px", "roi_y_px", "roi_w_px", "roi_h_px", "status", "elapsed_ms"),
)
# files written after the run; those of an earlier run must not remain next to this run's track
_WRITTEN_AFTERWARDS = (
    *("summary.json", "report.html", "smoothed.csv", "truth.tum", "dgps.tum"),
    *("track.kml", "track.geojson"),
)
_UPPER_TRIANGLE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
# session time
_FLUSH_EVERY_S = 0.5


class TrackFilesSink:
    """Write the tables of one run into ``folder``, which is created; other files in it are not modified.

    Raises `InputError` if the folder cannot be made or a file in it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._flushed_s = -math.inf
        # rows of detections.csv in their order, from the oldest one on that may change
        self._waiting = UnconfirmedRows[list[str]]()
        with ExitStack() as stack:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                for name in _WRITTEN_AFTERWARDS:
                    (folder / name).unlink(missing_ok=True)
                self._track = _open(stack, folder / "track.csv")
                self._triangulation = _open(stack, folder / "triangulation.csv")
                self._detections = _open(stack, folder / "detections.csv")
                self._tum = _open(stack, folder / "track.tum")
            except OSError as fault:
                raise InputError(str(folder), got=os_words(fault), wanted="a folder that can be written") from fault
            self._track.write(_line(TRACK_COLUMNS))
            self._triangulation.write(_line(TRIANGULATION_COLUMNS))
            self._detections.write(_line(DETECTION_COLUMNS))
            self._files = stack.pop_all()

    def __enter__(self) -> "TrackFilesSink":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, report: StepReport) -> None:
        """Append the rows of one step."""
        for cells, pixel in self._waiting.take(report, [_detection_cells(camera) for camera in report.cameras]):
            _set_pixel(cells, pixel)
        for cells in self._waiting.final():
            self._detections.write(_line(cells))
        for estimate in report.estimates:
            cells = _track_cells(estimate)
            self._track.write(_line(cells))
            self._triangulation.write(_line(_triangulation_cells(estimate)))
            if (pose := _tum_line(cells)) is not None:
                self._tum.write(pose)
        # without further pairs, too, the last rows are flushed
        times = [estimate.t_s for estimate in report.estimates] + [state.t_s for state in report.states]
        if any(abs(t_s - self._flushed_s) >= _FLUSH_EVERY_S for t_s in times):
            self._flushed_s = times[-1]
            self.flush()

    def flush(self) -> None:
        """Flush the rows but for those that wait: done every 0.5 s of session time, the most that a crash loses.

        Raises `OSError` where the disk takes no more; the rows are kept, and it may be called again.
        """
        for file in (self._detections, self._track, self._triangulation, self._tum):
            file.flush()

    def close(self) -> None:
        """Write what waits and close the files; may be called twice.

        Raises `OSError` where the disk takes no more; of one that took nothing no table is left.
        """
        try:
            with self._files:
                if not self._detections.closed:
                    for cells in self._waiting.rest():
                        self._detections.write(_line(cells))
        except OSError:
            # the only one without a header
            poses = self.folder / "track.tum"
            if not (self.folder / "track.csv").exists() and poses.exists() and poses.stat().st_size == 0:
                poses.unlink()
            raise


def write_track(path: Path, estimates: Iterable[TrackEstimate]) -> None:
    """Write a table like track.csv at once; raises `InputError` if the file can't be written."""
    try:
        with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="\n") as file:
            file.write(_line(TRACK_COLUMNS))
            file.writelines(_line(_track_cells(estimate)) for estimate in estimates)
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault


def _open(stack: ExitStack, path: Path) -> LineFile:
    """Open one table."""
    return stack.enter_context(LineFile(path))


def _line(cells: Iterable[str]) -> str:
    """Join the cells of one row; no cell needs quoting (station names have no commas)."""
    return ",".join(cells) + "\n"


def _number(value: float, form: str) -> str:
    """Format one number; a value that is not finite gives an empty cell."""
    return format(value, form) if math.isfinite(value) else ""


def _numbers(values: Iterable[float], form: str) -> list[str]:
    """Format some numbers, each as `_number` does."""
    return [_number(value, form) for value in values]


def _point(position_m: FloatArray | None) -> list[str]:
    """Format x, y, z to 0.1 µm, or three empty cells."""
    if position_m is None:
        return [""] * 3
    return _numbers(position_m.tolist(), ".7f")


def _track_cells(estimate: TrackEstimate) -> list[str]:
    """Return one row of track.csv."""
    cells = [_number(estimate.t_s, ".6f")]
    k = estimate.kinematics
    if k is None:
        cells += [""] * 12
    else:
        cells += _point(k.position_runway_m)
        cells += _numbers(k.velocity_runway_m_s.tolist(), ".6f")
        covariance = k.covariance.tolist()
        cells += _numbers([covariance[i][j] for i, j in _UPPER_TRIANGLE], ".9g")
    return [*cells, estimate.status.value]


def _triangulation_cells(estimate: TrackEstimate) -> list[str]:
    """Return one row of triangulation.csv; rays that do not intersect give a status without a point."""
    good = estimate.triangulation is not None and estimate.triangulation_status is TriangulationStatus.OK
    point = estimate.triangulation.point_runway_m if good and estimate.triangulation is not None else None
    return [_number(estimate.t_s, ".6f"), *_point(point), estimate.triangulation_status.value]


def _detection_cells(camera: CameraReport) -> list[str]:
    """Return one row of detections.csv."""
    cells = [_number(camera.t_s, ".6f"), camera.station]
    if isinstance(camera.result, Detection):
        found = camera.result
        sigma_u, sigma_v = (math.sqrt(max(0.0, float(found.covariance_px2[i, i]))) for i in (0, 1))
        cells += _numbers((found.u_px, found.v_px, sigma_u, sigma_v), ".4f")
    else:
        cells += [""] * 4
    roi = camera.roi
    cells += [""] * 4 if roi is None else [str(v) for v in (roi.x0, roi.y0, *roi.size)]
    return [*cells, camera.status.value, _number(1e3 * camera.elapsed_s, ".3f")]


def _set_pixel(cells: list[str], pixel: InitialPixel | None) -> None:
    """Set the pixel of a frame that was searched, or make a row one of a frame that was."""
    if pixel is None:
        cells[2:10], status = [""] * 8, DetectionStatus.MISS
    else:
        cells[2:6] = _numbers((pixel.u_px, pixel.v_px, pixel.sigma_px, pixel.sigma_px), ".4f")
        status = DetectionStatus.INITIAL
    cells[10] = status.value


def _tum_line(track_cells: list[str]) -> str | None:
    """Return one line of track.tum (identity attitude) from a row of track.csv, or None where that has no place."""
    time, *point = track_cells[:4]
    return None if "" in point else " ".join([time, *point, "0", "0", "0", "1"]) + "\n"
