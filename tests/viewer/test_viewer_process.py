"""Opening the viewer: the message when it cannot be shown."""

import os
import socket
import sys
import time
from pathlib import Path

import pytest
import rerun as rr

from groundstation.cli.main import main
from groundstation.viewer import viewer_process as rerun_viewer
from groundstation.viewer.viewer_process import (
    ViewerError,
    open_viewer,
    serve_recording,
    stop_viewer,
    video_notice,
    viewer_command,
    viewer_environment,
)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "session.rrd"
    path.write_bytes(b"")
    return path


def test_a_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(ViewerError, match=r"none\.rrd: no such recording"):
        open_viewer(tmp_path / "none.rrd", {"DISPLAY": ":0"})


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
def test_without_a_display_the_alternatives_are_reported(recording: Path) -> None:
    with pytest.raises(ViewerError, match=r"no display .* rerun --web-viewer"):
        open_viewer(recording, {})


def test_a_viewer_that_stops_at_once_is_an_error(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_viewer, "viewer_command", lambda _: [sys.executable, "-c", "raise SystemExit(3)"])
    with pytest.raises(ViewerError, match="exit code 3"):
        open_viewer(recording, {"DISPLAY": ":0"})


def test_the_viewer_listens_to_this_machine_and_reports_no_usage(recording: Path) -> None:
    command = viewer_command(recording)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    environment = {"HOME": "/home/a", "RERUN_ANALYTICS": "1"}
    assert viewer_environment(environment) == {"HOME": "/home/a", "RERUN_ANALYTICS": "0"}
    assert environment["RERUN_ANALYTICS"] == "1"


def test_a_missing_video_decoder_is_reported(tmp_path: Path) -> None:
    assert "ffmpeg" in video_notice({"PATH": str(tmp_path)})
    decoder = tmp_path / "ffmpeg"
    decoder.write_text("")
    decoder.chmod(0o755)
    assert video_notice({"PATH": str(tmp_path)}) == ""


def test_a_server_that_is_stopped_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.rrd"
    stream = rr.RecordingStream("a", send_properties=False)
    stream.save(path)
    stream.log("a", rr.Points3D([[0.0, 0.0, 0.0]]))
    stream.flush()
    stream.disconnect()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        wanted = int(taken.getsockname()[1])
        with pytest.raises(ViewerError, match=f"--port: got {wanted}, which is in use .*; wanted a free one"):
            serve_recording(path, os.environ, wanted)
        # before anything is prepared
        assert main(["view", str(path), "--web", "--port", str(wanted), "--save", str(tmp_path / "kept.rrd")]) == 1
        assert not (tmp_path / "kept.rrd").exists()
        monkeypatch.delattr("groundstation.cli.live._simulator")
        live = ["live", "--simulate", "--web", "--port", str(wanted)]
        assert main([*live, "--out", str(tmp_path / "live")]) == 1
        assert not (tmp_path / "live").exists()
    address, process = serve_recording(path, os.environ, wanted)
    port = int(address.split("/?")[0].rsplit(":", 1)[1])
    assert port == wanted
    deadline = time.monotonic() + 60.0
    while not _answers(port) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert _answers(port)
    stop_viewer(process)
    while _answers(port) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert not _answers(port)


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
