"""What `groundstation onboard fly` writes: the trajectory, and what became of each picture."""

import csv
import math
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.line_file import LineFile
from groundstation.onboard.edges.edges_file import NO_POSE
from groundstation.onboard.pose.agreement import PositionAgreement
from groundstation.onboard.pose.runway import CORNERS
from groundstation.onboard.scenes.nose_flight import attitude_of
from groundstation.onboard.visual_inertial.corner_finder import FoundCorners
from groundstation.onboard.visual_inertial.nose_report import NoseFix, NoseReport

TRACK_COLUMNS = (
    *("t_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"),
    *("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2"),
    *("roll_deg", "pitch_deg", "yaw_deg", "sigma_attitude_deg", "status"),
)
PICTURE_COLUMNS = (
    *("frame", "t_s", "edges", "outcome", "nis"),
    *(f"{corner.replace(' ', '_')}_{axis}_px" for corner in CORNERS for axis in ("u", "v")),
    *("pose_x_m", "pose_y_m", "pose_z_m", "reprojection_px"),
)
AGREEMENT_COLUMNS = ("t_s", "dx_m", "dy_m", "dz_m", "chi_square", "fused_x_m", "fused_y_m", "fused_z_m")
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class NoseFiles:
    """Write track.csv, track.tum and pictures.csv into a folder, row by row. Raises `InputError` if it cannot."""

    def __init__(self, folder: Path, heading_rad: float = 0.0) -> None:
        self._heading_rad = heading_rad
        self.files = tuple(folder / name for name in ("track.csv", "track.tum", "pictures.csv"))
        with ExitStack() as stack:
            try:
                track, self._tum, pictures = (stack.enter_context(LineFile(path)) for path in self.files)
            except OSError as fault:
                raise InputError(str(folder), got=os_words(fault), wanted="a folder to write to") from fault
            self._track = csv.writer(track, lineterminator="\n")
            self._pictures = csv.writer(pictures, lineterminator="\n")
            self._track.writerow(TRACK_COLUMNS)
            self._pictures.writerow(PICTURE_COLUMNS)
            self._stack = stack.pop_all()

    def __enter__(self) -> "NoseFiles":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._stack.close()

    def write(self, frame: int, report: NoseReport, corners_px: FloatArray | None) -> None:
        """Append a picture's rows; ``corners_px`` (4, 2) are those of the picture as it was taken, NaN if not seen."""
        fix = report.fix
        if fix is None:
            self._track.writerow([f"{report.t_s:.6f}", *[""] * (len(TRACK_COLUMNS) - 2), "waiting"])
        else:
            self._track.writerow(self._track_cells(fix))
            w, x, y, z = fix.runway_from_body_wxyz
            numbers = (*fix.position_m, x, y, z, w)
            self._tum.write(" ".join([f"{fix.t_s:.6f}", *(f"{value:.9g}" for value in numbers)]) + "\n")
        nis = report.innovation.nis if report.innovation is not None and report.corners is not None else math.nan
        cells = [str(frame), f"{report.t_s:.6f}", NO_POSE if report.edges is None else report.edges.status.value]
        cells += [report.outcome, "" if math.isnan(nis) else f"{nis:.3f}"]
        found = corners_px is not None and isinstance(report.corners, FoundCorners)
        pixels = corners_px.ravel() if found and corners_px is not None else np.full(8, np.nan)
        cells += ["" if math.isnan(value) else f"{value:.3f}" for value in pixels]
        pose = report.pose
        cells += [""] * 4 if pose is None else [*(f"{v:.3f}" for v in pose.position_m), f"{pose.reprojection_px:.3f}"]
        self._pictures.writerow(cells)

    def _track_cells(self, fix: NoseFix) -> list[str]:
        numbers = [*fix.position_m, *fix.velocity_m_s, *(fix.covariance[i, j] for i, j in _UPPER)]
        roll, pitch, yaw = attitude_of(fix.runway_from_body_wxyz)
        angles = np.degrees([roll, pitch, yaw + self._heading_rad, np.sqrt(np.trace(fix.covariance[3:6, 3:6]) / 3.0)])
        return [
            f"{fix.t_s:.6f}",
            *(f"{value:.6g}" for value in numbers),
            *(f"{value:.4f}" for value in angles),
            fix.status.value,
        ]


def write_agreement(path: Path, both: PositionAgreement) -> None:
    """Write the differences from the ground's track, and the fused position of both."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        out = csv.writer(stream, lineterminator="\n")
        out.writerow(AGREEMENT_COLUMNS)
        for t, d, square, fused in zip(both.t_s, both.difference_m, both.squares, both.fused_m, strict=True):
            out.writerow([f"{t:.6f}", *(f"{v:.4f}" for v in (*d, square, *fused))])


def agreement_words(both: PositionAgreement | None) -> str:
    """Return in lines for a person whether the ground's track and the aircraft's own agree."""
    if both is None:
        return "ground track: no time in common with the nose camera's"
    verdict = "agrees" if both.agree else "does not agree"
    off = ", ".join(f"{m:+.2f} ± {s:.2f}" for m, s in zip(both.mean_m, both.mean_sigma_m, strict=True))
    return (
        f"ground track: {verdict}; on board less ground {off} m (x, y, z) over {len(both.t_s)} epochs; "
        f"chi-square per degree of freedom {both.ratio:.2f}, limit {both.limit:.2f}"
    )
