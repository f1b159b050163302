"""The result files: exact columns, empty cells for absence, digits, and what happens to a folder in use."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.errors import InputError
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    InitialPixel,
    Kinematics,
    Miss,
    MissReason,
    StepReport,
    TrackEstimate,
    TrackState,
    TrackStatus,
    Triangulation,
    TriangulationStatus,
)
from groundstation.sinks.track_files import TrackFilesSink
from tests.files.limits import files_of_at_most

TRACK_HEADER = "t_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,cov_xx_m2,cov_xy_m2,cov_xz_m2,cov_yy_m2,cov_yz_m2,cov_zz_m2,status"
DETECTION_HEADER = "t_s,station,u_px,v_px,sigma_u_px,sigma_v_px,roi_x_px,roi_y_px,roi_w_px,roi_h_px,status,elapsed_ms"


def _estimate(t_s: float, rng: np.random.Generator) -> TrackEstimate:
    a = rng.normal(size=(6, 6))
    point = rng.normal(size=3) * 400
    return TrackEstimate(
        t_s=t_s,
        epoch=0,
        status=TrackStatus.TRACKING,
        kinematics=Kinematics(
            position_runway_m=point, velocity_runway_m_s=rng.normal(size=3) * 20, covariance=a @ a.T * 1e-5
        ),
        triangulation_status=TriangulationStatus.OK,
        triangulation=Triangulation(
            midpoint_runway_m=point + 2.0,
            point_runway_m=point + 1.0,
            covariance_m2=np.eye(3),
            gap_m=0.0,
            residual_sigma=0.5,
        ),
    )


def _nothing(t_s: float, status: TriangulationStatus = TriangulationStatus.ONE_VIEW) -> TrackEstimate:
    return TrackEstimate(
        t_s=t_s,
        epoch=1,
        status=TrackStatus.SEARCHING,
        kinematics=None,
        triangulation_status=status,
        triangulation=None,
    )


def _camera(found: bool) -> CameraReport:
    detection = Detection(
        u_px=640.125,
        v_px=480.5,
        covariance_px2=np.array([[0.25, 0.1], [0.1, 1.0]]),
        noise_px2=np.diag([0.02, 0.1]),
        centroid_px=np.array([641.0, 481.0]),
        box=Box(600.0, 470.0, 680.0, 490.0),
        area_px=300.0,
        contour_px=np.zeros((0, 2), np.float32),
        contrast_to_noise=9.0,
        channel="grey",
    )
    return CameraReport(
        t_s=1.0,
        station="left",
        epoch=0,
        status=DetectionStatus.OK if found else DetectionStatus.MISS,
        result=detection if found else Miss(reason=MissReason.LOW_CONTRAST),
        roi=Box(10, 20, 260, 120) if found else None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.0,
        tilt_rad=0.0,
        innovation=None,
        elapsed_s=0.0123,
    )


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_headers_are_the_contract(tmp_path: Path) -> None:
    TrackFilesSink(tmp_path).close()
    assert (tmp_path / "track.csv").read_text() == TRACK_HEADER + "\n"
    assert (tmp_path / "triangulation.csv").read_text() == "t_s,x_m,y_m,z_m,status\n"
    assert (tmp_path / "detections.csv").read_text() == DETECTION_HEADER + "\n"
    assert (tmp_path / "track.tum").read_text() == ""


def test_numbers_survive_the_file(tmp_path: Path, rng: np.random.Generator) -> None:
    """Expected: positions to 1e-6 m, covariances to six significant digits, the triangulated point is the ML one."""
    estimates = [_estimate(0.1 * k, rng) for k in range(20)]
    with TrackFilesSink(tmp_path) as sink:
        for estimate in estimates:
            sink.write(StepReport(estimates=(estimate,)))
    upper = np.triu_indices(3)
    tum = np.loadtxt(tmp_path / "track.tum")
    for k, (row, tri) in enumerate(
        zip(_rows(tmp_path / "track.csv"), _rows(tmp_path / "triangulation.csv"), strict=True)
    ):
        truth = estimates[k].kinematics
        assert truth is not None
        point = np.array([float(row[c]) for c in ("x_m", "y_m", "z_m")])
        np.testing.assert_allclose(point, truth.position_runway_m, rtol=0, atol=1e-6)
        covariance = [float(row[c]) for c in TRACK_HEADER.split(",")[7:13]]
        np.testing.assert_allclose(covariance, truth.covariance[:3, :3][upper], rtol=1e-6)
        ml = np.array([float(tri[c]) for c in ("x_m", "y_m", "z_m")])
        np.testing.assert_allclose(ml, truth.position_runway_m + 1.0, rtol=0, atol=1e-6)
        np.testing.assert_allclose(tum[k, 1:4], truth.position_runway_m, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(tum[:, 4:], np.tile([0, 0, 0, 1], (20, 1)))


def test_absence_is_an_empty_cell(tmp_path: Path) -> None:
    with TrackFilesSink(tmp_path) as sink:
        sink.write(StepReport(cameras=(_camera(False),), estimates=(_nothing(0.5),)))
    track = (tmp_path / "track.csv").read_text().splitlines()[1]
    assert track == "0.500000" + "," * 13 + "searching"
    assert (tmp_path / "triangulation.csv").read_text().splitlines()[1] == "0.500000,,,,one_view"
    assert (tmp_path / "detections.csv").read_text().splitlines()[1] == "1.000000,left,,,,,,,,,miss,12.300"
    assert (tmp_path / "track.tum").read_text() == ""


def test_not_finite_never_reaches_a_file(tmp_path: Path, rng: np.random.Generator) -> None:
    estimate = _estimate(0.0, rng)
    assert estimate.kinematics is not None
    estimate.kinematics.position_runway_m[1] = np.nan
    with TrackFilesSink(tmp_path) as sink:
        sink.write(StepReport(estimates=(estimate,)))
    assert "nan" not in (tmp_path / "track.csv").read_text()
    assert (tmp_path / "track.tum").read_text() == ""


def test_detection_row(tmp_path: Path) -> None:
    with TrackFilesSink(tmp_path) as sink:
        sink.write(StepReport(cameras=(_camera(True),)))
    (row,) = _rows(tmp_path / "detections.csv")
    assert [float(row[c]) for c in ("u_px", "v_px", "sigma_u_px", "sigma_v_px")] == [640.125, 480.5, 0.5, 1.0]
    assert [row[f"roi_{k}_px"] for k in "xywh"] == ["10", "20", "250", "100"]
    assert (row["status"], row["elapsed_ms"]) == ("ok", "12.300")


def test_rays_that_do_not_meet_give_no_point(tmp_path: Path) -> None:
    with TrackFilesSink(tmp_path) as sink:
        sink.write(StepReport(estimates=(_nothing(0.5, TriangulationStatus.RESIDUAL),)))
    assert _rows(tmp_path / "triangulation.csv")[0] == {
        "t_s": "0.500000",
        "x_m": "",
        "y_m": "",
        "z_m": "",
        "status": "residual",
    }


def test_each_step_is_on_disk_before_the_next(tmp_path: Path, rng: np.random.Generator) -> None:
    """Expected: a run that is killed leaves whole lines up to its last step."""
    sink = TrackFilesSink(tmp_path)
    for k in range(3):
        sink.write(StepReport(cameras=(_camera(True),), estimates=(_estimate(k, rng),)))
        for name in ("track.csv", "triangulation.csv", "detections.csv"):
            text = (tmp_path / name).read_text()
            assert text.endswith("\n")
            assert len(text.splitlines()) == k + 2
    sink.close()
    sink.close()


def test_folder_in_use_is_renewed_and_other_files_are_unchanged(tmp_path: Path) -> None:
    for name in ("track.csv", "summary.json", "report.html", "notes.txt", "session.rrd"):
        (tmp_path / name).write_text("old")
    TrackFilesSink(tmp_path).close()
    assert (tmp_path / "track.csv").read_text().startswith("t_s")
    assert not (tmp_path / "summary.json").exists()
    assert not (tmp_path / "report.html").exists()
    assert (tmp_path / "notes.txt").read_text() == "old"
    assert (tmp_path / "session.rrd").read_text() == "old"


def test_folder_is_made(tmp_path: Path) -> None:
    TrackFilesSink(tmp_path / "a" / "b").close()
    assert (tmp_path / "a" / "b" / "track.csv").is_file()


def test_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("x")
    with pytest.raises(InputError, match="taken"):
        TrackFilesSink(tmp_path / "taken")


def test_the_last_rows_do_not_wait_for_a_pair(tmp_path: Path, rng: np.random.Generator) -> None:
    """Expected: half a second after the last flush a heartbeat brings what is left to the file, and adds no row."""

    def rows() -> int:
        return len((tmp_path / "track.csv").read_text().splitlines()) - 1

    with TrackFilesSink(tmp_path) as sink:
        for k in range(3):
            sink.write(StepReport(estimates=(_estimate(10.0 + 0.1 * k, rng),)))
        before = rows()
        assert before < 3
        sink.write(StepReport(states=(TrackState(t_s=10.4, status=TrackStatus.COASTING, kinematics=None),)))
        assert rows() == before
        sink.write(StepReport(states=(TrackState(t_s=10.5, status=TrackStatus.COASTING, kinematics=None),)))
        assert rows() == 3
    assert rows() == 3


def _searched(t_s: float, station: str = "left") -> CameraReport:
    return CameraReport(
        t_s=t_s,
        station=station,
        epoch=0,
        status=DetectionStatus.MISS,
        result=Miss(reason=MissReason.NOT_ACQUIRED, detail="3 candidates"),
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.0,
        tilt_rad=0.0,
        innovation=None,
        elapsed_s=0.05,
    )


def _initial(t_s: float, u_px: float, station: str = "left") -> InitialPixel:
    return InitialPixel(t_s=t_s, station=station, u_px=u_px, v_px=7.0, sigma_px=1.5)


def _detection_rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "detections.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_searched_frame_gets_the_pixel_by_which_the_target_is_found_later(tmp_path: Path) -> None:
    sink = TrackFilesSink(tmp_path)
    for k in range(6):
        sink.write(StepReport(cameras=(_searched(0.1 * k), _searched(0.1 * k, "right"))))
    sink.write(StepReport(initial_pixels=(_initial(0.2, 5.0), _initial(0.4, 6.0), _initial(0.4, 8.0, "right"))))
    # of a frame that was never reported
    sink.write(StepReport(cameras=(_searched(0.6),), initial_pixels=(_initial(0.35, 9.0),)))
    sink.close()
    rows = _detection_rows(tmp_path)
    assert [(row["t_s"], row["station"]) for row in rows] == [
        *((f"{0.1 * k:.6f}", station) for k in range(6) for station in ("left", "right")),
        ("0.600000", "left"),
    ]
    found = {(row["t_s"], row["station"]): row for row in rows if row["u_px"]}
    assert {key: float(row["u_px"]) for key, row in found.items()} == {
        ("0.200000", "left"): 5.0,
        ("0.400000", "left"): 6.0,
        ("0.400000", "right"): 8.0,
    }
    for row in rows:
        assert row["status"] == ("initial" if row["u_px"] else "miss")
        assert row["elapsed_ms"] == "50.000"
        assert bool(row["sigma_u_px"]) == bool(row["u_px"])


def test_rows_of_a_long_search_do_not_wait_for_ever(tmp_path: Path) -> None:
    """Expected: rows older than five seconds are in the file, later ones on closing, and no pixel comes too late."""
    sink = TrackFilesSink(tmp_path)
    for k in range(100):
        sink.write(StepReport(cameras=(_searched(0.1 * k),), estimates=(_nothing(0.1 * k),)))
    assert 45 <= len(_detection_rows(tmp_path)) <= 50
    sink.write(StepReport(initial_pixels=(_initial(0.1 * 3, 5.0), _initial(0.1 * 97, 6.0))))
    sink.close()
    rows = _detection_rows(tmp_path)
    assert len(rows) == 100
    assert [k for k, row in enumerate(rows) if row["u_px"]] == [97]


def test_a_detection_releases_the_rows_of_the_search(tmp_path: Path) -> None:
    """Expected: of a target that was given, or found in labels, there are no pixels to come."""
    sink = TrackFilesSink(tmp_path)
    sink.write(StepReport(cameras=(_searched(0.0), _searched(0.0, "right"), _searched(0.1))))
    assert _flushed(sink, tmp_path) == []
    sink.write(StepReport(cameras=(_camera(True),)))
    assert [row["station"] for row in _flushed(sink, tmp_path)] == ["left", "right", "left", "left"]
    sink.close()


def _flushed(sink: TrackFilesSink, folder: Path) -> list[dict[str, str]]:
    sink._detections.flush()
    return _detection_rows(folder)


def test_a_full_disk_at_the_end_leaves_no_file_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sink = TrackFilesSink(tmp_path)
    sink.write(StepReport(cameras=(_searched(0.0),)))

    def full(_: str) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(sink, "_detections", _Full(sink._detections, full))
    with pytest.raises(OSError, match="No space"):
        sink.close()
    assert all(file.closed for file in (sink._track, sink._triangulation, sink._tum, sink._detections.file))


class _Full:
    """A text file to which nothing can be written."""

    def __init__(self, file: TextIO, write: Callable[[str], int]) -> None:
        self.file, self.write = file, write

    @property
    def closed(self) -> bool:
        return self.file.closed


def test_a_full_disk_leaves_no_empty_table(tmp_path: Path) -> None:
    """Expected: where the disk takes nothing at all, no file stands under its name, that without a header included."""
    sink = TrackFilesSink(tmp_path / "out")
    with files_of_at_most(0), pytest.raises(OSError, match="csv"):
        sink.close()
    assert list((tmp_path / "out").iterdir()) == []
