"""The live view of one camera: what reaches the viewer, and where the viewer listens."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from groundstation.box import Box
from groundstation.detection.pixel_track import PixelTrack
from groundstation.messages import Detection, Miss, MissReason, TrackStatus
from groundstation.viewer import viewer_process as rerun_viewer
from groundstation.viewer.live_track import APPLICATION, PICTURE, STATUS, LiveTrackView
from groundstation.viewer.viewer_process import ViewerError, live_viewer_command, open_live_stream
from tests.viewer.recording import Recording

SEEN = Detection(
    u_px=20.0,
    v_px=15.0,
    covariance_px2=np.eye(2),
    noise_px2=0.1 * np.eye(2),
    centroid_px=np.array([20.0, 15.0]),
    box=Box(14.5, 12.5, 26.5, 17.5),
    area_px=40.0,
    contour_px=np.array([[15.0, 13.0], [26.0, 13.0], [26.0, 17.0]], np.float32),
    contrast_to_noise=9.0,
    channel="grey",
)


def track(t_s: float, *, seen: bool) -> PixelTrack:
    result = SEEN if seen else Miss(reason=MissReason.NO_REGION)
    status = TrackStatus.TRACKING if seen else TrackStatus.COASTING
    return PixelTrack(t_s=t_s, status=status, result=result, roi=Box(4, 5, 34, 25), predicted_px=np.zeros(2))


def test_frames_and_detections_reach_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    stream = rr.RecordingStream(APPLICATION, send_properties=False)
    stream.save(path)
    with LiveTrackView(stream, "approach.mp4") as view:
        for k in range(6):
            view.write(np.full((48, 64, 3), 90, np.uint8), track(0.1 * k, seen=k != 3))
    recording = Recording(path)
    assert recording.times_ns(f"/{PICTURE}") == [round(1e8 * k) for k in range(6)]
    centres = recording.column(f"/{PICTURE}/box", "Boxes2D:centers")
    assert [row is not None and len(row) for row in centres].count(1) == 5
    assert centres[0] == [[21.0, 15.5]]
    assert recording.column(f"/{PICTURE}/target", "Points2D:positions")[0] == [[20.5, 15.5]]
    words = recording.column(f"/{STATUS}", "TextLog:text")
    assert words == [["tracking"], ["coasting"], ["tracking"]]


def test_the_live_viewer_listens_to_this_machine_alone() -> None:
    command = live_viewer_command(9999)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[command.index("--port") + 1] == "9999"


def test_the_live_viewer_keeps_so_much_and_no_more() -> None:
    """Expected: a stated bound, where Rerun's own is three quarters of the machine."""
    command = live_viewer_command(9999)
    assert command[command.index("--memory-limit") + 1] == "1GB"


def test_a_live_viewer_that_stops_at_once_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    stops = [rerun_viewer.sys.executable, "-c", "raise SystemExit(4)"]
    monkeypatch.setattr(rerun_viewer, "live_viewer_command", lambda _: stops)
    # how long an interpreter takes to begin and to end depends on what else the machine does
    monkeypatch.setattr(rerun_viewer, "STARTUP_S", 60.0)
    with pytest.raises(ViewerError, match=r"\(exit code 4\); try another"):
        open_live_stream(APPLICATION, {"DISPLAY": ":0"}, "try another")
