"""`groundstation track` for a user: the table, the overlay, the summary, and the messages for bad input."""

import csv
import itertools
import json
import re
import subprocess
import sys
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.detection.pixel_track import PixelTrack
from groundstation.errors import InputError
from groundstation.messages import TrackStatus
from groundstation.single_camera import track_video as track_video_module
from groundstation.single_camera.learned_tracker import LearnedPixelTracker
from groundstation.single_camera.pixel_track_file import PIXEL_TRACK_COLUMNS
from groundstation.single_camera.track_video import TrackRequest, track_video
from groundstation.sources import video_file
from groundstation.sources.video_file import VideoFile
from tests.damaged_video import damage
from tests.detection.flying import SIZE, Film, panorama

RECORDING = Path(__file__).resolve().parents[2] / "recordings" / "landing-1"
FRAMES = 30
RATE_HZ = 25.0
HIDDEN = range(20, 23)


@pytest.fixture(scope="module")
def film() -> Film:
    rng = np.random.default_rng(5)
    return Film(scene=panorama(rng), rng=rng, hidden=HIDDEN)


@pytest.fixture(scope="module")
def recorded(film: Film, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "approach.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, SIZE)
    for k in range(FRAMES):
        writer.write(film.frame(k))
    writer.release()
    return path


@pytest.fixture
def video(recorded: Path, tmp_path: Path) -> Path:
    """A copy in the test's own folder."""
    path = tmp_path / recorded.name
    path.write_bytes(recorded.read_bytes())
    return path


def init(film: Film, k: int = 0) -> str:
    return ",".join(f"{v:.1f}" for v in (film.box(k).x0, film.box(k).y0, *film.box(k).size))


def table(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def track(video: Path, *options: str, code: int = 0) -> list[dict[str, str]]:
    out = video.with_suffix(".csv")
    assert main(["track", str(video), "--out", str(out), *options]) == code
    return table(out)


# ---------------------------------------------------------------------------------------------- the table
def test_the_table(film: Film, video: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """One row for each frame; point and box where it was seen, empty cells where it was not."""
    rows = track(video, "--init", init(film))
    assert tuple(rows[0]) == PIXEL_TRACK_COLUMNS
    assert [int(r["frame"]) for r in rows] == list(range(FRAMES))
    assert [float(r["t_s"]) for r in rows] == pytest.approx([k / RATE_HZ for k in range(FRAMES)], abs=1e-3)
    for k, row in enumerate(rows):
        cells = [row[c] for c in PIXEL_TRACK_COLUMNS[2:8]]
        if k in HIDDEN:
            assert cells == [""] * 6
            assert row["status"] == "coasting"
        elif row["status"] == "tracking":
            u, v, x, y, w, h = map(float, cells)
            assert x <= u <= x + w
            assert y <= v <= y + h
            assert np.hypot(*(np.array([u, v]) - film.place(k))) < 0.6 * film.span_px
    assert sum(r["status"] == "tracking" for r in rows) >= FRAMES - len(HIDDEN) - 2
    shown = capfd.readouterr()
    assert shown.out.splitlines()[0].startswith(f"{FRAMES} frames, target seen in 2")
    assert "first seen in frame 0 at 0.00 s; longest gap 3 frames" in shown.out
    assert shown.out.splitlines()[-1] == f"wrote {video.with_suffix('.csv')}"
    assert f"track: {FRAMES} of {FRAMES} frames" in shown.err


def test_it_searches_without_a_start(video: Path) -> None:
    words = [r["status"] for r in track(video)]
    assert words[0] == "searching"
    assert "acquiring" in words[:8]
    assert words[15] == "tracking"
    assert set(words) <= {s.value for s in TrackStatus}


def test_a_box_may_begin_beyond_the_left_border(film: Film, video: Path) -> None:
    """Expected: its minus sign makes no option of it."""
    x, y, (w, h) = film.box(0).x0, film.box(0).y0, film.box(0).size
    assert x > 0
    box = f"{-10.0 - x:.1f},{y:.1f},{w + 2.0 * (10.0 + x):.1f},{h:.1f}"
    rows = track(video, "--init", box, "--to-frame", "3")
    assert len(rows) == 4


def test_an_empty_box(film: Film, video: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Expected: plain sky is never tracked; a line reports it, and the aircraft is found by searching."""
    rows = track(video, "--init", "30,20,40,24", "--to-frame", "19")
    assert rows[0]["status"] == "acquiring"
    seen = [(k, row) for k, row in enumerate(rows) if row["status"] == "tracking"]
    assert len(seen) >= 5
    for k, row in seen:
        assert np.hypot(*(np.array([float(row["u_px"]), float(row["v_px"])]) - film.place(k))) < 0.6 * film.span_px
    assert all(row["u_px"] == "" for row in rows if row["status"] != "tracking")
    assert "nothing was found in the box of --init" in capfd.readouterr().err
    track(video, "--init", init(film), "--to-frame", "1")
    assert "nothing was found" not in capfd.readouterr().err


def test_a_part_of_it(film: Film, video: Path) -> None:
    """--init belongs to the first frame of the part; the last frame is included."""
    rows = track(video, "--from-frame", "8", "--to-frame", "13", "--init", init(film, 8))
    assert [int(r["frame"]) for r in rows] == [8, 9, 10, 11, 12, 13]
    assert float(rows[0]["t_s"]) == pytest.approx(8 / RATE_HZ, abs=1e-3)
    assert {r["status"] for r in rows} == {"tracking"}


def test_a_part_from_far_inside_is_the_same_frames(tmp_path: Path) -> None:
    """Beyond 200 frames the video is entered by a seek; each frame carries its number as its brightness."""
    path = tmp_path / "long.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (64, 48))
    for k in range(260):
        writer.write(np.full((48, 64, 3), 20 + (k % 50) * 4, np.uint8))
    writer.release()
    frames = list(VideoFile(path).frames(235, 240))
    assert [f.index for f in frames] == list(range(235, 241))
    assert [float(f.image.mean()) for f in frames] == pytest.approx(
        [20 + (k % 50) * 4 for k in range(235, 241)], abs=3.5
    )
    assert [f.t_s for f in frames] == pytest.approx([k / 25.0 for k in range(235, 241)], abs=1e-3)


# -------------------------------------------------------------------------------------------- the overlay
def test_the_overlay_is_a_video_of_all_frames(film: Film, video: Path) -> None:
    seen = video.with_name("seen.mp4")
    track(video, "--init", init(film), "--save-video", str(seen))
    drawn, plain = cv2.VideoCapture(str(seen)), cv2.VideoCapture(str(video))
    count = 0
    while (pair := (drawn.read(), plain.read()))[0][0]:
        x0, y0, x1, y1 = (round(v) for v in film.box(count))
        off = np.abs(pair[0][1].astype(int) - pair[1][1].astype(int))[max(y0, 0) : y1, max(x0, 0) : x1]
        # coloured lines around the target, where it is seen
        assert (off.max() > 60) == (count not in HIDDEN), count
        count += 1
    assert count == FRAMES
    assert drawn.get(cv2.CAP_PROP_FPS) == pytest.approx(RATE_HZ)


# ------------------------------------------------------------------------------------------ what is wrong
def refused(capsys: pytest.CaptureFixture[str], arguments: list[str], *messages: str, code: int = 1) -> None:
    """Nothing could be done: one line, exit code 1, or 2 for wrong usage."""
    assert main(["track", *arguments]) == code
    shown = capsys.readouterr()
    assert not shown.out
    assert shown.err.count("\n") == 1, shown.err
    assert shown.err.startswith("groundstation: ")
    assert all(m in shown.err for m in messages), shown.err


def test_what_is_no_video(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = tmp_path / "notes.mp4"
    text.write_text("no video")
    out = ["--out", str(tmp_path / "a.csv")]
    refused(capsys, [str(tmp_path / "none.mp4"), *out], "none.mp4: got no such file; wanted a video file")
    refused(capsys, [str(tmp_path), *out], "got a folder; wanted a video file")
    refused(capsys, [str(text), *out], "notes.mp4: got no video that OpenCV can open; wanted a complete video file")
    assert [p.name for p in tmp_path.iterdir()] == ["notes.mp4"]
    # FFmpeg draws such files as a terminal would
    table = tmp_path / "ptu.txt"
    table.write_text("t_s,left_pan_deg,left_tilt_deg\n" * 500)
    refused(capsys, [str(table), *out], "ptu.txt: got a file .txt; wanted a video file")


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--init", "900,10,20,20"], 1, "--init: got a box at 900,10 of 20 x 20 px; wanted one whose middle is in the"),
        (
            ["--from-frame", "9", "--to-frame", "3"],
            2,
            "got frames 9 to 3; wanted 0 or later, and a start before the end",
        ),
        (["--from-frame", "-1"], 2, "got frames -1 to the end; wanted 0 or later"),
        (["--from-frame", "99"], 1, "got a video of 30 frames; wanted more, to start from frame 99"),
        (["--save-video", "seen.gif"], 2, "--save-video: got seen.gif; wanted the name of an .mp4 file"),
    ],
)
def test_impossible_requests(
    video: Path, capsys: pytest.CaptureFixture[str], options: list[str], code: int, message: str
) -> None:
    refused(capsys, [str(video), "--out", str(video.with_suffix(".csv")), *options], message, code=code)
    assert [p.name for p in video.parent.iterdir()] == [video.name]


# the last one in shares of the picture
@pytest.mark.parametrize("text", ["1,2,3", "a,b,c,d", "1,2,0,5", "1,2,3,nan", "", "0.5,0.4,0.1,0.1"])
def test_a_malformed_start_is_wrong_usage(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["track", "a.mp4", "--out", "b.csv", "--init", text])
    assert left.value.code == 2
    assert f"argument --init: got {text!r}; wanted X,Y,W,H in px" in capsys.readouterr().err


def test_an_output_that_cannot_be_written(video: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing, folder = video.parent / "none" / "a.csv", video.parent / "folder.csv"
    folder.mkdir()
    refused(capsys, [str(video), "--out", str(missing)], f"got no folder {missing.parent}; wanted a file in a folder")
    refused(capsys, [str(video), "--out", str(folder)], "folder.csv: got Is a directory; wanted a file that can be")
    seen = folder.rename(folder.with_suffix(".mp4"))
    out = ["--out", str(video.with_suffix(".csv"))]
    refused(capsys, [str(video), *out, "--save-video", str(seen)], "got Is a directory; wanted a video that can be")


def test_the_video_itself_is_never_written_over(video: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = video.read_bytes()
    refused(capsys, [str(video), "--out", str(video)], "got a file that is read; wanted another --out")
    both = str(video.with_name("both.mp4"))
    refused(
        capsys,
        [str(video), "--out", both, "--save-video", both],
        "got a file that --out names, too; wanted another --save-video",
    )
    assert video.read_bytes() == before


def test_a_video_cut_short_is_tracked_up_to_its_end(
    film: Film, video: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: rows up to the last whole frame, one line that states where it ended, exit code 1."""
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    rows = track(video, "--init", init(film), code=1)
    assert 8 <= len(rows) <= 16
    last = [line for line in capsys.readouterr().err.replace("\r", "\n").splitlines() if "fault" in line]
    assert len(last) == 1
    assert f"frame {len(rows)}: got the end of the video after {len(rows)} frames of the {FRAMES}" in last[0]


def test_damaged_frames_are_rows_without_a_target(film: Film, video: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: the video continues after them with right numbers and times, a line with the count, exit code 0."""
    damage(video, range(10, 13))
    rows = track(video, "--init", init(film))
    assert [int(r["frame"]) for r in rows] == list(range(FRAMES))
    assert [float(r["t_s"]) for r in rows] == pytest.approx([k / RATE_HZ for k in range(FRAMES)], abs=1e-3)
    for row in rows[10:13]:
        assert row["status"] == "coasting"
        assert row["u_px"] == row["x_px"] == ""
    for k in (9, 14, 15, 16):
        assert np.hypot(*(np.array([float(rows[k]["u_px"]), float(rows[k]["v_px"])]) - film.place(k))) < 12.0
    reported = capsys.readouterr()
    assert f"{FRAMES} frames, target seen in 2" in reported.out
    assert f"3 damaged frames in {video}, the first number 10" in reported.err


@pytest.mark.parametrize("frames", [range(FRAMES - 1, FRAMES), range(FRAMES - 9, FRAMES), range(24)])
@pytest.mark.parametrize("options", [(), ("--to-frame", str(FRAMES - 1)), ("--from-frame", str(FRAMES - 3))])
def test_damage_up_to_the_end_or_from_the_beginning(
    video: Path, frames: range, options: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the frames are in the file, so they have rows, and none is reported missing."""
    damage(video, frames)
    rows = track(video, *options)
    first = FRAMES - 3 if "--from-frame" in options else 0
    assert [int(r["frame"]) for r in rows] == list(range(first, FRAMES))
    times = [float(r["t_s"]) for r in rows]
    assert times == pytest.approx([k / RATE_HZ for k in range(first, FRAMES)], abs=1e-3)
    asked = [k for k in frames if k >= first]
    reported = capsys.readouterr().err
    assert ("damaged frame" in reported) == bool(asked)
    if asked:
        assert f"number {asked[0]}" in reported


def test_a_video_cut_short_is_at_fault_wherever_it_is_to_end(video: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: frames that are not in the file are missing, not damaged."""
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    rows = track(video, "--from-frame", "5", "--to-frame", "25", code=1)
    assert 5 <= len(rows) <= 16
    reported = capsys.readouterr().err
    assert f"got the end of the video after {5 + len(rows)} frames of the {FRAMES}" in reported
    assert "damaged" not in reported


def copy_beginning(video: Path, copy: Path, frames: int) -> None:
    """Write the first frames of a video as they are coded."""
    with av.open(str(video)) as source, av.open(str(copy), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in itertools.islice(source.demux(source.streams.video[0]), frames):
            packet.stream = stream
            target.mux(packet)


def test_frames_shown_in_another_order_than_coded_keep_their_numbers(tmp_path: Path) -> None:
    """Expected: by the stamps, each decoded frame has the number that it has in the undamaged file.

    The recording's videos have frames that are coded after later ones.
    """
    whole = tmp_path / "whole.mp4"
    # so many coded frames are the first to be shown, too
    copy_beginning(RECORDING / "left.mp4", whole, 101)
    content = bytearray(whole.read_bytes())
    undamaged = {round(f.t_s, 6): f.index for f in VideoFile(whole).frames()}
    assert len(undamaged) == 101
    start = content.index(b"mdat") + 4
    length = len(content) - start
    at = start + int(0.35 * length)
    # longer than a frame, so that the beginning of one is among it
    content[at : at + 60_000] = bytes(60_000)
    path = tmp_path / "damaged.mp4"
    path.write_bytes(content)
    video = VideoFile(path)
    numbers = []
    for frame in video.frames():
        assert undamaged[round(frame.t_s, 6)] == frame.index
        numbers.append(frame.index)
    assert video.lost
    assert sorted(numbers + video.lost) == list(range(len(undamaged)))


@pytest.mark.parametrize("frames", [range(2), range(8, 11), range(14, 16)])
def test_damage_at_the_first_and_last_requested_frame(film: Film, video: Path, frames: range) -> None:
    """Expected: one row for each requested frame, wherever the damage is."""
    damage(video, frames)
    rows = track(video, "--from-frame", "0" if 0 in frames else "10", "--to-frame", "15")
    assert [int(r["frame"]) for r in rows] == list(range(0 if 0 in frames else 10, 16))
    times = [float(r["t_s"]) for r in rows]
    assert times == pytest.approx([int(r["frame"]) / RATE_HZ for r in rows], abs=1e-3)
    assert all(a < b for a, b in itertools.pairwise(times))
    assert all(rows[k - int(rows[0]["frame"])]["status"] != "tracking" for k in frames if k >= int(rows[0]["frame"]))


def test_an_interrupt_keeps_the_finished_rows(
    film: Film, video: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: exit code 130, the rows until then, and an overlay video that opens."""
    whole_step = LearnedPixelTracker.step

    def step(self: LearnedPixelTracker, image: np.ndarray, t_s: float) -> PixelTrack:
        if t_s > 9.5 / RATE_HZ:
            raise KeyboardInterrupt
        return whole_step(self, image, t_s)

    monkeypatch.setattr(LearnedPixelTracker, "step", step)
    seen = video.with_name("seen.mp4")
    rows = track(video, "--init", init(film), "--save-video", str(seen), code=130)
    assert len(rows) == 10
    assert "interrupted" in (said := capsys.readouterr().err)
    assert re.search(r"; \S+\.csv ends after 10 frames$", said.strip())
    assert cv2.VideoCapture(str(seen)).get(cv2.CAP_PROP_FRAME_COUNT) == 10


def test_an_interrupt_before_the_first_frame_leaves_no_empty_video(
    video: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: no file that no program reads, and one of an earlier run as it was."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(track_video_module, "warm_up", interrupted)
    seen = video.with_name("seen.mp4")
    assert track(video, "--save-video", str(seen), code=130) == []
    assert not seen.exists()
    seen.write_bytes(b"an earlier one")
    track(video, "--save-video", str(seen), code=130)
    assert seen.read_bytes() == b"an earlier one"
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
def test_a_view_without_a_display(
    video: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    refused(
        capsys, [str(video), "--out", str(video.with_suffix(".csv")), "--view"], "no display for --view; --save-video "
    )
    assert not video.with_suffix(".csv").exists()


# --------------------------------------------------------------------------------------------- the source
class Stamped:
    """A capture that gives the stamps it was made with, in ms, and black frames."""

    def __init__(self, stamps_ms: list[float]) -> None:
        self.stamps_ms, self.at = stamps_ms, -1

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return True

    def grab(self) -> bool:
        self.at += 1
        return self.at < len(self.stamps_ms)

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((48, 64, 3), np.uint8)

    def get(self, what: int) -> float:
        known = {
            cv2.CAP_PROP_POS_MSEC: self.stamps_ms[min(self.at, len(self.stamps_ms) - 1)],
            cv2.CAP_PROP_FRAME_WIDTH: 64.0,
            cv2.CAP_PROP_FRAME_HEIGHT: 48.0,
            cv2.CAP_PROP_FPS: 10.0,
        }
        return known.get(what, 0.0)

    def release(self) -> None:
        self.at = len(self.stamps_ms)


@pytest.mark.parametrize(
    ("stamps_ms", "times_s"),
    [
        ([0.0, 40.0, 200.0, 230.0], [0.0, 0.04, 0.2, 0.23]),
        ([500.0, 600.0, 700.0], [0.5, 0.6, 0.7]),
        ([0.0, 0.0, 0.0, 0.0], [0.0, 0.1, 0.2, 0.3]),
        ([0.0, 100.0, 50.0, 300.0], [0.0, 0.1, 0.2, 0.3]),
        ([0.0, float("nan"), 200.0], [0.0, 0.1, 0.2]),
    ],
)
def test_times_are_the_container_s_where_they_grow(
    stamps_ms: list[float], times_s: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_file, "open_video", lambda _: Stamped(stamps_ms))
    path = tmp_path / "a.mp4"
    path.write_bytes(b"")
    assert [f.t_s for f in VideoFile(path).frames()] == pytest.approx(times_s)


def test_a_start_beyond_the_end_of_a_video_without_a_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_file, "open_video", lambda _: Stamped([0.0, 100.0]))
    path = tmp_path / "a.mp4"
    path.write_bytes(b"")
    result = track_video(TrackRequest(video=path, out=tmp_path / "a.csv", from_frame=5))
    assert isinstance(result.fault, InputError)
    assert "got a video of 2 frames; wanted more, to start from frame 5" in str(result.fault)
    assert result.frames == 0


# -------------------------------------------------------------------------------------------- real pictures
def scored(shared_data: Path, clip: str, out: Path, first: int, last: int) -> dict[str, float]:
    """Return the independent scorer's result for a table."""
    scorer = shared_data.parent / "tools" / "score_boxes.py"
    if not scorer.is_file():
        pytest.skip(f"independent scorer not found at {scorer}")
    boxes = shared_data / "aircraft-clips" / "boxes.csv"
    command = [sys.executable, str(scorer), str(boxes), clip, str(out), str(first), str(last)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answer: dict[str, float] = json.loads(done.stdout)
    return answer


@pytest.mark.parametrize(
    ("clip", "start", "first", "last"),
    [
        # a hand-held camera over trees, with a start; then found before masts, and large close by
        ("V_AIRPLANE_021", "475,288,33,22", 0, 180),
        ("V_AIRPLANE_022", None, 15, 90),
        ("V_AIRPLANE_002", None, 15, 140),
    ],
)
def test_real_clips(shared_data: Path, tmp_path: Path, clip: str, start: str | None, first: int, last: int) -> None:
    """At least 95 % hit and at most 3 % wrong, as the independent scorer counts it."""
    out = tmp_path / "track.csv"
    video = shared_data / "aircraft-clips" / f"{clip}.mp4"
    options = [] if start is None else ["--init", start]
    assert main(["track", str(video), "--out", str(out), "--to-frame", str(last), *options]) == 0
    score = scored(shared_data, clip, out, first, last)
    assert score["frames"] >= 70
    assert score["hit"] >= 0.95
    assert score["wrong"] <= 0.03


def test_empty_cloud_is_never_tracked(shared_data: Path, tmp_path: Path) -> None:
    """A box of plain sky: from the first point on it is the aircraft, found by searching; cloud was `tracking` here."""
    out, video = tmp_path / "track.csv", shared_data / "aircraft-clips" / "V_AIRPLANE_001.mp4"
    assert main(["track", str(video), "--out", str(out), "--to-frame", "30", "--init", "60,60,40,20"]) == 0
    rows = table(out)
    first = next(k for k, row in enumerate(rows) if row["u_px"])
    assert 3 <= first <= 15
    assert {row["status"] for row in rows[:first]} <= {"acquiring", "searching"}
    for row in rows[first:]:
        # the labelled boxes of these frames, 10 px to each side
        assert 275 <= float(row["u_px"]) <= 360
        assert 190 <= float(row["v_px"]) <= 240
