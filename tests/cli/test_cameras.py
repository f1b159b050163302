"""`groundstation cameras`: help, wrong usage, what it prints of a video played as a camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.cli.main import main


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for i in range(15):
        writer.write(np.full((48, 64, 3), 10 + 10 * i, np.uint8))
    writer.release()
    return path


def test_show_prints_settings_rate_and_clock(video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "p.png"
    assert main(["cameras", "show", f"file:{video}", "--seconds", "20", "--save", str(picture)]) == 0
    printed = capsys.readouterr()
    assert "64 × 48 px" in printed.out
    assert "measured      25.000 Hz" in printed.out
    assert "0 lost" in printed.out
    assert "clock         none to be fitted: a frame of a file has the time at which it is due" in printed.out
    assert "opened" in printed.err
    assert "the file ends after 15 frames" in printed.err
    assert cv2.imread(str(picture)).shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["show", "camera"], "wanted genicam:SERIAL"),
        (["show", "file:/no/such.mp4"], "got no such file; wanted a video"),
        (["show", "opencv:77"], "got nothing that opens"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cameras", *arguments]) == 1
    printed = capsys.readouterr().err.splitlines()
    ours = [line for line in printed if line.startswith("groundstation: ")]
    assert len(ours) == 1
    assert complaint in ours[0]
    assert not any("Traceback" in line for line in printed)


def test_a_picture_that_cannot_be_written_is_reported_first(video: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path, code, wanted in (("p.xyz", 2, "wanted .png, .jpg, .tif"), ("/no/such/p.png", 1, "a folder that exists")):
        assert main(["cameras", "show", f"file:{video}", "--save", path]) == code
        assert wanted in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["show"],
        ["show", "opencv:0", "--seconds", "0"],
        ["show", "opencv:0", "--roi", "1,2,3"],
        ["show", "opencv:0", "--roi", "0,0,0,5"],
        ["show", "opencv:0", "--exposure-ms", "nan"],
        ["show", "opencv:0", "--stamp", "later"],
    ],
)
def test_wrong_usage(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["cameras", *arguments])
    assert stop.value.code == 2
