"""The table edges.csv: one row per frame, written incrementally."""

import math
from pathlib import Path
from types import TracebackType

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.line_file import LineFile
from groundstation.onboard.edges.line_state import A, B, C, D
from groundstation.onboard.edges.report import EdgeReport, Edges
from groundstation.onboard.edges.seen_marks import SeenMark

CORNERS = ("far_left", "near_left", "far_right", "near_right")
NO_POSE = "no_pose"
EDGE_COLUMNS = (
    *("frame", "t_s", "a", "b", "c_m", "d_m", "sigma_turn_deg", "sigma_c_m", "sigma_d_m"),
    *(f"{corner}_{axis}_px" for corner in CORNERS for axis in ("u", "v")),
    *(f"sigma_{corner}_px" for corner in CORNERS),
    *("line_probability", "line_outwards_m", "sigma_line_m"),
    *("lamps_probability", "lamps_outwards_m", "sigma_lamps_m"),
    *("status", "miss"),
)


def corner_pixels(edges: Edges) -> FloatArray:
    """Return the corners (4, 2) px, as in `CORNERS`: where the edges meet the upper and the lower row."""
    return np.column_stack([edges.crossings_px, np.tile(edges.rows_px, 2)])


def _cells(mark: SeenMark) -> list[str]:
    """Return a mark's probability, place and sigma; without a place where none is possible."""
    place = [f"{mark.outwards_m:.2f}", f"{mark.sigma_m:.2f}"] if math.isfinite(mark.outwards_m) else ["", ""]
    return [f"{mark.probability:.3f}", *place]


class EdgesFile:
    """Write edges to ``path``; an older file is replaced. Raises `InputError` if it cannot be written."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = LineFile(path)
        except OSError as fault:
            raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault
        self._file.write(",".join(EDGE_COLUMNS) + "\n")
        self.rows = 0

    def __enter__(self) -> "EdgesFile":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._file.close()

    def write(self, frame: int, t_s: float, report: EdgeReport | None, corners_px: FloatArray | None) -> None:
        """Append a frame's row; ``report`` is None without a pose, ``corners_px`` (4, 2) without edges."""
        cells = [str(frame), f"{t_s:.6f}"]
        edges = None if report is None else report.edges
        if edges is None or corners_px is None:
            cells += [""] * (len(EDGE_COLUMNS) - 4)
        else:
            mean, covariance = edges.state.mean, edges.state.covariance
            across = np.array([-mean[B], mean[A]])
            turn = math.sqrt(max(float(across @ covariance[:2, :2] @ across), 0.0))
            sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
            cells += [f"{v:.6f}" for v in (mean[A], mean[B])] + [f"{v:.3f}" for v in (mean[C], mean[D])]
            cells += [f"{math.degrees(turn):.4f}", f"{sigmas[C]:.3f}", f"{sigmas[D]:.3f}"]
            cells += [f"{v:.2f}" for v in corners_px.ravel()]
            cells += [f"{v:.2f}" for v in np.sqrt(np.diag(edges.covariance_px2))]
            cells += [""] * 6 if edges.marks is None else [*_cells(edges.marks.line), *_cells(edges.marks.lamps)]
        cells += [NO_POSE, ""] if report is None else [report.status.value, report.miss.value]
        self._file.write(",".join(cells) + "\n")
        self._file.flush()
        self.rows += 1
