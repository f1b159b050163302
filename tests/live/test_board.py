"""The operator's display in words."""

import math
from dataclasses import replace

import numpy as np
import pytest

from groundstation.live.camera_status import clock_status, lost_frames
from groundstation.live.status_board import DeviceState, StatusBoard, dropped_text
from groundstation.messages import Kinematics, TrackEstimate, TrackState, TrackStatus, TriangulationStatus
from groundstation.sources.cameras.camera import CameraCounts
from groundstation.sources.cameras.host_clock_fit import ClockFitState


def answer(epoch: int, status: TrackStatus = TrackStatus.TRACKING, t_s: float = 0.0) -> TrackEstimate:
    return TrackEstimate(
        t_s=t_s,
        epoch=epoch,
        status=status,
        kinematics=Kinematics(
            position_runway_m=np.array([1.25, 212.0, 9.5]),
            velocity_runway_m_s=np.zeros(3),
            covariance=np.diag([0.01, 0.25, 0.01, 1.0, 1.0, 1.0]),
        ),
        triangulation_status=TriangulationStatus.ONE_VIEW,
        triangulation=None,
    )


def test_latency_is_from_the_first_frame_to_the_result() -> None:
    board = StatusBoard()
    for k in range(100):
        board.arrived(k, 0.1 * k)
        board.arrived(k, 0.1 * k + 0.003)
        board.answered(answer(k, t_s=0.1 * k), 0.1 * k + (0.050 if k == 99 else 0.010))
    assert board.latency_ms(50) == pytest.approx(10.0, abs=0.5)
    assert board.latency_ms(100) == pytest.approx(50.0, abs=0.5)
    status = board.status(10.0, TrackStatus.TRACKING, (), {"frames of left": 2}, "recording, 3 MB/s")
    assert status.lines[0] == "tracking at 212 ± 0.5 m, x +1.2 ± 0.10, z 9.5 ± 0.10"
    assert "delay 10 ms" in status.one_line()
    assert "dropped: 2 frames of left" in status.one_line()
    assert status.one_line().endswith("recording, 3 MB/s")


def state(t_s: float, status: TrackStatus, sigma_y_m: float | None) -> TrackState:
    known = answer(0).kinematics
    assert known is not None
    grown = None if sigma_y_m is None else replace(known, covariance=np.diag([0.01, sigma_y_m**2, 0.01, 1.0, 1.0, 1.0]))
    return TrackState(t_s=t_s, status=status, kinematics=grown)


def test_without_pairs_the_prediction_and_the_age_of_the_newest_pair_are_shown() -> None:
    """Expected: position and grown sigma of the heartbeat; the pair's age from half a second on; lost has no place."""
    board = StatusBoard()
    board.answered(answer(0, t_s=10.0), 10.02)

    def reported(now_s: float, track: TrackStatus) -> str:
        return board.status(now_s, track, (), {}, "").lines[0]

    assert reported(10.5, TrackStatus.TRACKING).endswith("z 9.5 ± 0.10")
    board.passed(state(10.5, TrackStatus.COASTING, 4.0))
    coasting = "coasting: predicted, no fix of two cameras at 212 ± 4.0 m, x +1.2 ± 0.10, z 9.5 ± 0.10"
    assert reported(10.5, TrackStatus.COASTING) == coasting
    assert reported(10.51, TrackStatus.COASTING) == coasting + ", no pair for 0.5 s"
    board.passed(state(19.0, TrackStatus.LOST, None))
    assert reported(19.05, TrackStatus.LOST) == "lost: searching the predicted region, no pair for 9.1 s"
    board.answered(answer(1, t_s=20.0), 20.02)
    assert reported(20.02, TrackStatus.TRACKING).startswith("tracking at 212 ± 0.5 m")


def test_of_one_camera_alone_only_the_bearing_is_measured() -> None:
    """Expected: the camera is named while it sees the target, and no longer once pairs stop."""
    board = StatusBoard()

    def reported(stations: set[str]) -> str:
        one = replace(answer(0, TrackStatus.COASTING, t_s=10.0), seen_by=frozenset(stations))
        board.answered(one, 10.02)
        return board.status(10.1, TrackStatus.COASTING, (), {}, "").lines[0]

    where = " at 212 ± 0.5 m, x +1.2 ± 0.10, z 9.5 ± 0.10"
    assert reported({"left"}) == "coasting: bearing only, left alone sees it" + where
    for stations in (set[str](), {"left", "right"}):
        assert reported(stations) == "coasting: predicted, no fix of two cameras" + where
    assert reported({"left"}).startswith("coasting: bearing only")
    board.passed(state(10.5, TrackStatus.COASTING, 4.0))
    assert board.status(10.5, TrackStatus.COASTING, (), {}, "").lines[0].startswith("coasting: predicted")


def test_outdated_states_are_not_shown_as_present() -> None:
    """Expected: neither a place nor the word for what the track was a second and more ago."""
    board = StatusBoard()
    board.answered(answer(0, t_s=10.0), 10.02)
    assert board.status(11.0, TrackStatus.TRACKING, (), {}, "").lines[0].startswith("tracking at 212")
    line = board.status(11.01, TrackStatus.TRACKING, (), {}, "").lines[0]
    assert line == "unknown: was tracking, no status for the last 1.0 s"
    board.passed(state(11.01, TrackStatus.COASTING, 2.0))
    assert board.status(11.01, TrackStatus.COASTING, (), {}, "").lines[0].startswith("coasting: predicted")


def test_before_the_first_result_no_age_is_shown() -> None:
    board = StatusBoard()
    board.passed(state(-1e9, TrackStatus.SEARCHING, None))
    assert board.status(6.1, TrackStatus.SEARCHING, (), {}, "").lines[0] == "unknown: no pair processed yet"


def test_a_count_of_one_is_in_the_singular() -> None:
    dropped = {"frames of left": 1, "frames of right": 2, "readings": 1, "pairs, being behind": 1}
    assert dropped_text(dropped) == "dropped: 1 frame of left, 2 frames of right, 1 reading, 1 pair, being behind"


def test_zero_has_no_sign() -> None:
    """Expected: -0.04 m is printed as +0.0."""
    board, newest = StatusBoard(), answer(0)
    assert newest.kinematics is not None
    near = replace(newest.kinematics, position_runway_m=np.array([-0.04, 212.0, -0.04]))
    board.answered(replace(newest, kinematics=near), 0.0)
    reported = board.status(0.0, TrackStatus.TRACKING, (), {}, "").lines[0]
    assert reported == "tracking at 212 ± 0.5 m, x +0.0 ± 0.10, z 0.0 ± 0.10"


def test_before_anything_has_come() -> None:
    board = StatusBoard()
    nothing = DeviceState(name="left camera", rate_hz=0.0, age_s=math.inf, note="")
    status = board.status(0.0, TrackStatus.SEARCHING, (nothing,), {}, "")
    assert status.lines == ("searching the sky", "left camera nothing yet")
    assert board.latency_ms(99) == 0.0


def test_a_silent_device_is_reported() -> None:
    assert DeviceState(name="left PTU", rate_hz=80.2, age_s=0.01, note="ready").summary() == "left PTU 80 Hz, ready"
    assert DeviceState(name="left PTU", rate_hz=0.0, age_s=2.5).summary() == "left PTU 0 Hz, silent for 2.5 s"


def test_a_rate_is_that_of_the_last_seconds() -> None:
    board = StatusBoard()
    for k in range(100):
        rate = board.rate("camera", 30 * k, float(k))
    assert rate == pytest.approx(30.0)
    for k in range(100, 110):
        rate = board.rate("camera", 30 * 99, float(k))
    assert rate == 0.0


def test_a_cameras_clock_is_described_in_words() -> None:
    """Expected: offset, drift, envelope and its sigma; nothing from before the start of listening."""
    clock = ClockFitState(
        offset_s=1234.56789, drift=12.4e-6, sigma_s=0.00004, drift_sigma=1e-7, spread_s=0.00031, bins=60
    )
    words = clock_status(clock, has_clock=True)
    assert words == (
        "its clock 1234.5679 s behind ours, drifts +12 ppm, pictures 0.31 ms later than the quickest, "
        "known to ± 0.04 ms"
    )
    assert "0.5000 s ahead of ours" in clock_status(replace(clock, offset_s=-0.5), has_clock=True)
    assert "drifts +0 ppm" in clock_status(replace(clock, drift=-1e-9), has_clock=True)
    for early in (replace(clock, bins=7), replace(clock, sigma_s=4.3)):
        assert clock_status(early, has_clock=True) == "its clock is still being found"
    assert clock_status(None, has_clock=True) == ""
    assert clock_status(None, has_clock=False) == "no clock of its own: stamped on arrival"
    before = CameraCounts(dropped=59, lost=2)
    assert lost_frames(CameraCounts(dropped=59, lost=2), before) == ""
    assert lost_frames(CameraCounts(dropped=61, lost=3, incomplete=1), before) == "1 incomplete, 1 lost, 2 dropped"


def test_devices_in_order_are_named_and_those_in_trouble_come_first() -> None:
    """Expected: rates and clocks on demand; silence and faults always."""
    devices = (
        DeviceState(name="left camera", rate_hz=30.0, age_s=0.02, note="its clock 12.0 s behind ours"),
        DeviceState(name="right camera", rate_hz=30.0, age_s=0.02, note="3 lost", trouble=True),
        DeviceState(name="left PTU", rate_hz=0.0, age_s=4.0, note="line lost", trouble=True),
        DeviceState(name="right PTU", rate_hz=80.0, age_s=0.01, note="ready"),
    )
    status = StatusBoard().status(1.0, TrackStatus.SEARCHING, devices, {"frames of left": 2}, "recording", ("GO",))
    brief = [line for line, _ in status.rows(details=False)]
    assert brief == [
        "searching the sky",
        "GO",
        "right camera 30 Hz, 3 lost",
        "left PTU 0 Hz, silent for 4.0 s, line lost",
        "in order: left camera, right PTU",
        "dropped: 2 frames of left",
        "recording",
    ]
    assert [line for line, silent in status.rows(details=False) if silent] == [brief[3]]
    assert [line for line, _ in status.rows(details=True)] == list(status.lines)
    assert "its clock 12.0 s behind ours" in status.one_line()
    assert "behind ours" not in status.one_line(details=False)
