"""The whole job on sessions without videos: pixels of another detector, N stations, starts of each kind."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import InputError
from groundstation.estimation.config import FilterImplementation
from groundstation.evaluation.accuracy_table import format_accuracy_table
from groundstation.messages import PixelMeasurement, PtuSample
from groundstation.replay.replay import ReplayRequest, replay
from tests.stereo_rig import BASELINE_M, FOCAL_PX, STEP_RAD, flight_events, glide, make_rig

pytestmark = pytest.mark.usefixtures("unrendered_figures")

PLACES = {"left": (-BASELINE_M / 2, 0.0), "right": (BASELINE_M / 2, 0.0), "third": (40.0, 100.0)}
DGPS_LATE_S = 0.25


def rig_toml(names: tuple[str, ...], fixed: bool, focal_px: float) -> str:
    text = 'format = "stereo-ptu-rig/1"\n'
    for name in names:
        x, y = PLACES[name]
        text += (
            f'\n[[station]]\nname = "{name}"\nfixed = {str(fixed).lower()}\n'
            f"ptu_position_m = [{x}, {y}, 1.5]\nrunway_from_base_wxyz = [1.0, 0.0, 0.0, 0.0]\n"
            f"head_from_camera_wxyz = [{0.5**0.5}, {-(0.5**0.5)}, 0.0, 0.0]\nimage_size_px = [1280, 960]\n"
            f"focal_px = [{focal_px}, {focal_px}]\nprincipal_point_px = [639.5, 479.5]\n"
        )
        if not fixed:
            text += f"ptu_resolution_deg = {np.degrees(STEP_RAD)}\nptu_sigma_deg = 0.0\n"
    return text


@pytest.fixture
def make_session(tmp_path: Path) -> Callable[..., Path]:
    """Write a detections-only session of the shared synthetic glide."""

    def write(names: tuple[str, ...] = ("left", "right"), extra: str = "") -> Path:
        folder = tmp_path / "session"
        folder.mkdir()
        (folder / "rig.toml").write_text(rig_toml(names, False, FOCAL_PX))
        (folder / "session.toml").write_text(f'name = "labels"\n[target]\nspan_m = 2.3\n{extra}')
        readings: dict[float, dict[str, PtuSample]] = {}
        with (folder / "detections.csv").open("w", newline="") as stream:
            table = csv.writer(stream)
            table.writerow(["t_s", "station", "u_px", "v_px"])
            for event in flight_events(make_rig(names), glide, np.random.default_rng(3)):
                if isinstance(event, PixelMeasurement):
                    table.writerow([f"{event.t_s:.6f}", event.station, f"{event.u_px:.3f}", f"{event.v_px:.3f}"])
                elif isinstance(event, PtuSample):
                    readings.setdefault(round(event.t_s, 6), {})[event.station] = event
        with (folder / "ptu.csv").open("w", newline="") as stream:
            table = csv.writer(stream)
            table.writerow(["t_s", *(f"{n}_{axis}_deg" for n in names for axis in ("pan", "tilt"))])
            for t, by_name in sorted(readings.items()):
                cells = [v for n in names for v in (by_name[n].pan_rad, by_name[n].tilt_rad)]
                table.writerow([f"{t:.6f}", *(f"{np.degrees(v):.6f}" for v in cells)])
        generator = np.random.default_rng(4)
        with (folder / "dgps.csv").open("w", newline="") as stream:
            table = csv.writer(stream)
            table.writerow(["t_s", "x_m", "y_m", "z_m"])
            for t in np.arange(0.0, 12.0, 0.1):
                place = glide(t) + generator.normal(0, 0.015, 3)
                table.writerow([f"{t + DGPS_LATE_S:.4f}", *(f"{v:.4f}" for v in place)])
        return folder

    return write


def run(session: Path, tmp_path: Path, tuning: str = "", *, pages: bool = False) -> dict:
    """Replay a session; ``pages``: with its report and its Rerun recording, which have no part in the figures."""
    config = None
    if tuning:
        config = tmp_path / "tuning.toml"
        config.write_text(tuning)
    out = tmp_path / "out"
    result = replay(ReplayRequest(session=session, out=out, config=config, rerun=pages, report=pages))
    assert result.fault is None
    for path in result.files:
        assert path.stat().st_size > 0, path
    return json.loads((out / "summary.json").read_text())


def test_two_stations(make_session: Callable[..., Path], tmp_path: Path) -> None:
    """Acquired by itself, tracked to the end, every file written, the DGPS clock found."""
    summary = run(make_session(), tmp_path, pages=True)
    assert summary["counts"]["track"]["tracking"] > 100
    offset = summary["reference"]["time_offset"]
    assert offset["offset_s"] == pytest.approx(DGPS_LATE_S, abs=0.03)
    rmse = summary["accuracy"]["dgps"]["total"]["ekf"]["rmse_m"]
    assert rmse[0] < 0.05
    assert rmse[1] < 1.5


def test_smoothed_over_the_flight(make_session: Callable[..., Path], tmp_path: Path) -> None:
    """--smooth: track.csv's rows, estimates where it has them, nearer to DGPS; an older run's is not left lying."""
    session, out = make_session(), tmp_path / "out"
    result = replay(ReplayRequest(session=session, out=out, rerun=False, smooth=True))
    assert out / "smoothed.csv" in result.files
    track, smoothed = (
        list(csv.DictReader((out / name).read_text().splitlines())) for name in ("track.csv", "smoothed.csv")
    )
    assert [(row["t_s"], row["status"]) for row in smoothed] == [(row["t_s"], row["status"]) for row in track]
    assert [row["x_m"] == "" for row in smoothed] == [row["x_m"] == "" for row in track]
    table = json.loads((out / "summary.json").read_text())["accuracy"]["dgps"]["smoothed"]
    assert table["epochs"] > 90
    assert table["rmse_m"][1] < 0.8 * table["ekf_rmse_m"][1]
    assert "smoothed over the flight: RMSE" in format_accuracy_table(result.evaluation.summary)
    replay(ReplayRequest(session=session, out=out, rerun=False, report=False))
    assert not (out / "smoothed.csv").exists()


def test_three_stations_pin_the_range(make_session: Callable[..., Path], tmp_path: Path) -> None:
    summary = run(make_session(("left", "right", "third")), tmp_path, pages=True)
    assert summary["accuracy"]["dgps"]["total"]["ekf"]["rmse_m"][1] < 0.4
    assert set(summary["counts"]["detection"]) == {"left", "right", "third"}


def test_a_given_start(make_session: Callable[..., Path], tmp_path: Path) -> None:
    """[initial] is used as it is, at its time: no acquiring."""
    x, y, z = glide(0.0)
    extra = (
        f"[initial]\nt_s = 0.0\nposition_m = [{x}, {y}, {z}]\nvelocity_m_s = [0.0, -25.0, -1.5]\n"
        "sigma_position_m = 1.0\nsigma_velocity_m_s = [1.0, 1.0, 1.0]\n"
    )
    summary = run(make_session(extra=extra), tmp_path)
    assert summary["counts"]["track"]["acquiring"] + summary["counts"]["track"]["searching"] <= 1


def test_a_start_from_dgps(make_session: Callable[..., Path], tmp_path: Path) -> None:
    """Although its clock is off by 0.25 s: the start allows for half a second."""
    summary = run(make_session(), tmp_path, 'start = "dgps"\n')
    assert summary["counts"]["track"]["tracking"] > 105
    assert summary["accuracy"]["dgps"]["total"]["ekf"]["rmse_m"][0] < 0.05


def test_a_search_can_be_requested(make_session: Callable[..., Path], tmp_path: Path) -> None:
    extra = (
        "[initial]\nt_s = 0.0\nposition_m = [0, 99, 9]\nvelocity_m_s = [0, -25, 0]\n"
        "sigma_position_m = 1.0\nsigma_velocity_m_s = 1.0\n"
    )
    summary = run(make_session(extra=extra), tmp_path, 'start = "search"\n')
    assert summary["counts"]["track"]["tracking"] > 100


def test_a_start_that_is_not_there_is_an_error(make_session: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no \[initial\]"):
        run(make_session(), tmp_path, 'start = "initial"\n')


@pytest.mark.parametrize("predictor", ["curve", "line"])
def test_other_predictors_can_be_chosen(make_session: Callable[..., Path], tmp_path: Path, predictor: str) -> None:
    summary = run(make_session(), tmp_path, f'[estimation]\npredictor = "{predictor}"\n')
    assert summary["configuration"]["estimation"]["predictor"] == predictor
    assert summary["counts"]["track"]["tracking"] > 100


def test_filterpys_filter_gives_the_same_track(make_session: Callable[..., Path], tmp_path: Path) -> None:
    """Expected: the rows of the compiled filter, numbers to a unit of their last digit, and the same counts."""
    session, tracks, counts = make_session(), [], []
    for implementation in FilterImplementation:
        summary = run(session, tmp_path, f'[estimation]\nimplementation = "{implementation}"\n')
        assert summary["configuration"]["estimation"]["implementation"] == implementation
        counts.append(summary["counts"])
        tracks.append(list(csv.DictReader((tmp_path / "out" / "track.csv").read_text().splitlines())))
    assert counts[0] == counts[1]
    assert len(tracks[0]) == len(tracks[1]) > 100
    for row, theirs in zip(*tracks, strict=True):
        assert row["status"] == theirs["status"]
        for name in ("x_m", "y_m", "z_m", "vx_m_s", "cov_xx_m2", "cov_yy_m2"):
            assert (row[name] == "") == (theirs[name] == "")
            if row[name]:
                assert float(row[name]) == pytest.approx(float(theirs[name]), rel=1e-4, abs=1e-4)


def test_real_labels_need_a_calibrated_rig(shared_data: Path, tmp_path: Path) -> None:
    """Four fixed cameras of unknown orientation: reported in one line, with the remedy."""
    with pytest.raises(InputError, match="calibrate flight"):
        replay(ReplayRequest(session=shared_data / "drone-flight-3", out=tmp_path / "out"))
