"""Several recordings in one: every row below its run's name, moved in time by the event that is at 0."""

import itertools
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.messages import Kinematics, StepReport, TrackEstimate, TrackStatus, TriangulationStatus
from groundstation.replay.run_planning import SourceKind, plan_runs, source_kind
from groundstation.replay.view import ViewRequest, names_line, prepare_view
from groundstation.rig.rig import Rig, load_rig
from groundstation.sinks.track_files import TrackFilesSink
from groundstation.viewer import viewer_process as rerun_viewer
from groundstation.viewer.entity_paths import BACKGROUND, RANGE_COLOURS, range_colour
from groundstation.viewer.merge_recordings import RunAlignment, read_track
from groundstation.viewer.recording_check import check_recording
from groundstation.viewer.rerun_sink import RerunSink
from groundstation.viewer.viewer_process import web_viewer_command

ROOT = Path(__file__).resolve().parents[2]
PAIRS = 60


def estimates(start_s: float) -> list[TrackEstimate]:
    """A descent of 6 s that is on the ground for its last two."""
    made = []
    for k in range(PAIRS):
        position = np.array([0.2, 300.0 - 2.5 * k, max(0.3, 10.3 - 0.25 * k)])
        kinematics = Kinematics(
            position_runway_m=position,
            velocity_runway_m_s=np.array([0.0, -25.0, -2.5]),
            covariance=np.diag([0.01, 0.5, 0.02, 0.1, 0.1, 0.1]) + 0.001,
        )
        made.append(
            TrackEstimate(
                t_s=start_s + 0.1 * k,
                epoch=k,
                status=TrackStatus.TRACKING if k else TrackStatus.ACQUIRING,
                kinematics=kinematics if k else None,
                triangulation_status=TriangulationStatus.ONE_VIEW,
                triangulation=None,
            )
        )
    return made


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(ROOT / "recordings" / "landing-1" / "rig.toml")


@pytest.fixture(scope="module")
def two(rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two runs' folders, which no test changes."""
    days = tmp_path_factory.mktemp("days")
    folders = (days / "monday", days / "tuesday")
    for folder, start_s in zip(folders, (5.0, 1000.0), strict=True):
        folder.mkdir()
        sink = RerunSink(folder / "session.rrd", rig, session_name=folder.name)
        for estimate in estimates(start_s):
            sink.write(StepReport(estimates=(estimate,)))
        sink.close()
    return folders


@pytest.fixture(scope="module", autouse=True)
def checked_once() -> Iterator[None]:
    """A recording is read to its end by a process of its own, and a file that has not changed since then is whole."""
    whole: set[tuple[Path, int, int]] = set()

    def check(path: Path) -> None:
        state = path.stat() if path.is_file() else None
        content = (path.resolve(), state.st_size, state.st_mtime_ns) if state else None
        if content not in whole:
            check_recording(path)
            if content is not None:
                whole.add(content)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("groundstation.replay.view.check_recording", check)
        yield


def moving(path: Path, entity: str) -> pa.Table:
    reader = RrdReader(path)
    rows = [
        c.to_record_batch()
        for c in reader.stream(store=reader.recordings()[0])
        if c.entity_path == entity and not c.is_static
    ]
    return pa.Table.from_batches([b.select(["session_time", *b.schema.names[2:]]) for b in rows])


def seconds(table: pa.Table) -> np.ndarray:
    return np.sort(table.column("session_time").cast(pa.int64()).to_numpy()) / 1e9


def show(sources: tuple[Path, ...], tmp_path: Path, align: RunAlignment | None) -> Path:
    out = tmp_path / "both.rrd"
    prepare_view(ViewRequest(sources=sources, work=tmp_path / "work", align=align, save=out))
    return out


@pytest.mark.parametrize(
    ("align", "first_s"),
    # the first estimate is the second pair, put at 1 s; the ground (0.5 m above the lowest), at pair 38, at 4 s
    [(RunAlignment.NONE, (5.0, 1000.0)), (RunAlignment.START, (0.9, 0.9)), (RunAlignment.TOUCHDOWN, (0.2, 0.2))],
)
def test_every_row_is_below_its_run_at_its_moved_time(
    two: tuple[Path, Path], tmp_path: Path, align: RunAlignment, first_s: tuple[float, float]
) -> None:
    both = show(two, tmp_path, align)
    for folder, start_s in zip(two, first_s, strict=True):
        t_s = seconds(moving(both, f"/{folder.name}/aircraft/ekf"))
        np.testing.assert_allclose(t_s, start_s + 0.1 * np.arange(PAIRS), atol=1e-6)
        assert seconds(moving(both, f"/{folder.name}/aircraft/ekf/ellipsoid"))[0] == t_s[0]
        # the run's name goes with its track
        marked, named = (moving(both, f"/{folder.name}/aircraft/ekf{part}") for part in ("", "/name"))
        assert named.column("Points3D:positions") == marked.column("Points3D:positions")
        np.testing.assert_array_equal(seconds(named), t_s)


def contrast(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    """Return the contrast ratio of two sRGB colours (W3C, WCAG 2.2)."""

    def luminance(colour: tuple[float, ...]) -> float:
        linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in np.array(colour) / 255.0]
        return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_labels_can_be_read_in_the_dark_and_the_light_theme(two: tuple[Path, Path], tmp_path: Path) -> None:
    """Expected: all text in the scene has a contrast of 4.5:1 (WCAG AA) to the box that each theme puts behind it."""
    both = show(two, tmp_path, RunAlignment.START)
    reader, labelled = RrdReader(both), {}
    for chunk in reader.stream(store=reader.recordings()[0]):
        batch = chunk.to_record_batch()
        if chunk.is_static and "Points3D:labels" in batch.schema.names:
            labelled[chunk.entity_path] = batch.column("Points3D:colors")[0].as_py()
    names = {"/world/runway/distance", *(f"/world/stations/{s}/name" for s in ("left", "right")), "/aircraft/ekf/name"}
    assert {path for path in labelled if path.startswith("/monday")} >= {
        f"/monday{name}" for name in names if "runway" not in name
    }
    assert any(path.endswith("/world/runway/distance") for path in labelled)
    light = tuple(0.57 * v + 0.43 * 255.0 for v in BACKGROUND)
    for path, (packed,) in labelled.items():
        colour = tuple(float(v) for v in packed.to_bytes(4, "big")[:3])
        assert contrast(colour, tuple(map(float, BACKGROUND))) >= 4.5, path
        assert contrast(colour, light) >= 4.5, path


@pytest.mark.parametrize(("align", "at_s"), [(RunAlignment.START, 1.0), (RunAlignment.TOUCHDOWN, 4.0)])
def test_nothing_lies_before_0_and_the_event_is_marked(
    two: tuple[Path, Path], tmp_path: Path, align: RunAlignment, at_s: float
) -> None:
    """Expected: no row of any entity at a negative time, where Rerun draws no JPEG; a line and words at the event's."""
    both = show(two, tmp_path, align)
    reader = RrdReader(both)
    rows = 0
    for chunk in reader.stream(store=reader.recordings()[0]):
        batch = chunk.to_record_batch()
        if not chunk.is_static and "session_time" in batch.schema.names:
            times = batch.column("session_time").cast(pa.int64()).to_numpy()
            assert times.min() >= 0, chunk.entity_path
            rows += len(times)
    assert rows > 4 * PAIRS
    np.testing.assert_allclose(seconds(moving(both, "/runs/log")), [at_s], atol=1e-6)
    np.testing.assert_allclose(seconds(moving(both, "/runs/event")), at_s, atol=2e-3)


def test_nothing_is_lost_and_rerun_finds_no_fault(two: tuple[Path, Path], tmp_path: Path) -> None:
    both = show(two, tmp_path, RunAlignment.START)
    command = [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(both)]
    done = subprocess.run(
        command, env={**os.environ, "RERUN_ANALYTICS": "0"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    reader = RrdReader(both)
    found = {c.entity_path for c in reader.stream(store=reader.recordings()[0])}
    for number, folder in enumerate(two):
        one = RrdReader(folder / "session.rrd")
        own = {c.entity_path for c in one.stream(store=one.recordings()[0])}
        expected = {
            f"/{folder.name}{e}".rstrip("/")
            for e in own
            if not e.startswith("/__properties") and (number == 0 or not e.startswith("/world/runway"))
        }
        assert expected <= found
    assert len(reader.blueprints()) == 1
    assert not any(e.startswith("/tuesday/world/runway") for e in found)


def test_runs_that_never_meet_in_time_are_shown_from_their_starts(two: tuple[Path, Path], tmp_path: Path) -> None:
    result = prepare_view(ViewRequest(sources=two, work=tmp_path / "work"))
    assert result.align is RunAlignment.START
    assert "no time in common" in result.notes[0]
    assert "start of each at 1 s" in names_line(result, two)
    same = prepare_view(ViewRequest(sources=(two[0], two[0]), work=tmp_path / "work"))
    assert same.align is RunAlignment.NONE
    assert same.names[0] != same.names[1]


@pytest.mark.parametrize("count", [1, 2])
def test_a_recording_is_not_written_onto_itself(two: tuple[Path, Path], tmp_path: Path, count: int) -> None:
    """Expected: a folder's own recording as --save is refused in words, and left as it is."""
    save = two[0] / "session.rrd"
    before = save.read_bytes()
    with pytest.raises(InputError, match="a file that is read; wanted another --save"):
        prepare_view(ViewRequest(sources=two[:count], work=tmp_path / "work", save=save))
    assert save.read_bytes() == before


def test_a_truncated_recording_is_reported_in_one_line(
    two: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.rrd"
    whole = (two[0] / "session.rrd").read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        assert main(["view", str(cut), "--save", str(tmp_path / "x.rrd")]) == 1
    assert warned == []
    reported = capfd.readouterr().err.splitlines()
    assert len(reported) == 1, reported
    assert reported[0].startswith("groundstation: ")
    assert "cut.rrd: got " in reported[0]


def test_one_recording_is_shown_unchanged(two: tuple[Path, Path], tmp_path: Path) -> None:
    result = prepare_view(ViewRequest(sources=two[:1], work=tmp_path / "work"))
    assert result.recording == two[0] / "session.rrd"


def test_a_single_recording_that_is_damaged_is_refused(two: tuple[Path, Path], tmp_path: Path) -> None:
    cut = tmp_path / "cut.rrd"
    whole = (two[0] / "session.rrd").read_bytes()
    middle = len(whole) // 2
    for content in (b"hi", bytes(64), whole[:middle] + bytes(64) + whole[middle + 64 :]):
        cut.write_bytes(content)
        with pytest.raises(InputError, match=r"cut\.rrd: got .*wanted a Rerun recording"):
            prepare_view(ViewRequest(sources=(cut,), work=tmp_path / "work", save=tmp_path / "kept.rrd"))
        assert not (tmp_path / "kept.rrd").exists()


def test_a_recording_is_not_written_over(two: tuple[Path, Path], tmp_path: Path) -> None:
    path = two[0] / "session.rrd"
    before = path.read_bytes()
    with pytest.raises(InputError, match="got a file that is read; wanted another --save"):
        prepare_view(ViewRequest(sources=(path, two[1]), work=tmp_path, save=path))
    assert path.read_bytes() == before


def test_tables_alone_give_the_same_track(two: tuple[Path, Path], tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    with TrackFilesSink(folder) as sink:
        for estimate in estimates(5.0):
            sink.write(StepReport(estimates=(estimate,)))
    result = prepare_view(ViewRequest(sources=(folder,), work=tmp_path / "work"))
    from_tables = moving(result.recording, "/tables/aircraft/ekf/ellipsoid")
    from_run = moving(two[0] / "session.rrd", "/aircraft/ekf/ellipsoid")
    for column in ("Ellipsoids3D:centers", "Ellipsoids3D:half_sizes"):
        rows = [
            np.concatenate([np.ravel(r) for r in t.sort_by("session_time").column(column).to_pylist()])
            for t in (from_tables, from_run)
        ]
        np.testing.assert_allclose(rows[0], rows[1], rtol=1e-5, atol=1e-5)


def searching(start_s: float) -> list[TrackEstimate]:
    """Six seconds of nothing."""
    return [replace(e, status=TrackStatus.SEARCHING, kinematics=None) for e in estimates(start_s)]


@pytest.mark.parametrize("tables", [False, True])
def test_a_run_without_an_estimate_is_shown_next_to_the_others_and_reported(
    two: tuple[Path, Path], rig: Rig, tmp_path: Path, tables: bool
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    sink = TrackFilesSink(empty) if tables else RerunSink(empty / "session.rrd", rig, session_name="empty")
    for estimate in searching(40.0):
        sink.write(StepReport(estimates=(estimate,)))
    sink.close()
    out = tmp_path / "both.rrd"
    result = prepare_view(
        ViewRequest(sources=(two[0], empty), work=tmp_path / "work", align=RunAlignment.START, save=out)
    )
    assert any(note.startswith("empty: no estimate in it, so no track") for note in result.notes)
    assert not any(note.startswith("monday") for note in result.notes)
    np.testing.assert_allclose(seconds(moving(out, "/empty/status/track"))[0], 1.0, atol=1e-6)
    assert len(seconds(moving(out, "/monday/aircraft/ekf/path"))) == PAIRS - 2
    alone = prepare_view(ViewRequest(sources=(empty, empty), work=tmp_path / "work"))
    assert len([note for note in alone.notes if "no track" in note]) == 2


def test_a_session_that_cannot_be_replayed_shows_its_pictures_and_references(tmp_path: Path) -> None:
    landing = ROOT / "recordings" / "landing-1"
    session = tmp_path / "uncalibrated"
    session.mkdir()
    for name in ("session.toml", "frames.csv", "ptu.csv", "dgps.csv", "left.mp4", "right.mp4"):
        (session / name).symlink_to(landing / name)
    rig = (landing / "rig.toml").read_text().replace('name = "left"', 'name = "left"\nknown = ["position", "lens"]')
    (session / "rig.toml").write_text(rig)
    result = prepare_view(ViewRequest(sources=(session,), work=tmp_path / "work"))
    assert "not replayed, so pictures of left and right, the DGPS path alone" in result.notes[0]
    assert "calibrated orientation" in result.notes[0]
    assert len(result.notes) == 1
    pairs = len((landing / "frames.csv").read_text().split()) - 1
    assert len(seconds(moving(result.recording, "/uncalibrated/cameras/left/image"))) == pairs
    fixes = len((landing / "dgps.csv").read_text().split()) - 1
    assert len(seconds(moving(result.recording, "/uncalibrated/aircraft/dgps"))) == fixes
    for name in ("frames.csv", "dgps.csv"):
        (session / name).unlink()
    with pytest.raises(InputError, match="uncalibrated"):
        prepare_view(ViewRequest(sources=(session,), work=tmp_path / "work"))


def test_a_run_without_a_touchdown_is_reported_when_aligned_by_it(
    two: tuple[Path, Path], rig: Rig, tmp_path: Path
) -> None:
    above = tmp_path / "above"
    above.mkdir()
    sink = RerunSink(above / "session.rrd", rig, session_name="above")
    for estimate in estimates(3.0):
        k = estimate.kinematics
        raised = None if k is None else replace(k, position_runway_m=k.position_runway_m + [0.0, 0.0, 30.0])
        sink.write(StepReport(estimates=(replace(estimate, kinematics=raised),)))
    sink.close()
    request = ViewRequest(sources=(two[0], above), work=tmp_path / "work", align=RunAlignment.TOUCHDOWN)
    (note,) = prepare_view(request).notes
    assert note.startswith("above: no touchdown in it, the track is never below 30 m: put by the time")
    assert prepare_view(replace(request, align=RunAlignment.START)).notes == ()
    # the panel of the runs, the log and the terminal agree
    mixed = prepare_view(request)
    stated = f"touchdown (of above, without one, the lowest height) of each at {mixed.event_s:.0f} s"
    assert stated in names_line(mixed, request.sources)
    assert "each one's touchdown (of above, without one, the lowest height) is at" in words(mixed.recording)
    neither = prepare_view(replace(request, sources=(above, above)))
    assert "each one's lowest height (within 0.5 m; no touchdown) is at" in words(neither.recording)
    both = prepare_view(replace(request, sources=two))
    assert "each one's touchdown is at" in words(both.recording)


def words(path: Path) -> str:
    """The words in the panel of the runs."""
    reader = RrdReader(path)
    (chunk,) = [c for c in reader.stream(store=reader.recordings()[0]) if c.entity_path == "/runs" and c.is_static]
    return str(chunk.to_record_batch().column("TextDocument:text").to_pylist()[0][0])


def test_a_recording_too_large_for_a_browser_is_reported_and_none_of_it_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "large.rrd"
    with path.open("wb") as file:
        file.truncate(1_999_000_000)
    command = web_viewer_command(path, 1, 2)
    assert command[command.index("--server-memory-limit") + 1] == "3998MB"
    assert rerun_viewer.browser_notice(path) == ""
    with path.open("wb") as file:
        file.truncate(2_300_000_000)
    assert "2.3 GB may be more than a browser holds" in rerun_viewer.browser_notice(path)


def test_a_file_of_another_name_is_refused_before_anything_is_done(
    two: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(two[0]), "--save", str(tmp_path / "two.txt")]) == 2
    assert "wanted a name that ends in .rrd" in capsys.readouterr().err
    assert not (tmp_path / "two.txt").exists()


def test_a_live_runs_folder_is_its_recording(tmp_path: Path) -> None:
    run = tmp_path / "monday"
    run.mkdir()
    (run / "track.csv").write_text("")
    assert source_kind(run) is SourceKind.RESULTS
    (run / "flight.mcap").write_bytes(b"")
    (planned,) = plan_runs([run])
    assert (planned.name, planned.source, planned.kind) == ("monday", run / "flight.mcap", SourceKind.SESSION)
    # what it was replayed to since is not replayed once more
    (run / "summary.json").write_text("")
    assert plan_runs([run])[0].source == run


def test_what_holds_no_track_of_ours_is_named(two: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "other.rrd"
    stream = rr.RecordingStream("other", send_properties=False)
    stream.save(other)
    stream.log("a", rr.Points3D([[0.0, 0.0, 0.0]]))
    stream.flush()
    stream.disconnect()
    with pytest.raises(InputError, match=r"other\.rrd: got no track"):
        read_track(other)
    other.write_bytes(b"no recording")
    with pytest.raises(InputError, match=r"other\.rrd"):
        show((other, two[0]), tmp_path, None)


def test_named_frames_get_the_runs_name() -> None:
    from groundstation.viewer.merge_recordings import _frame, _renamed

    names = pa.array([["left.head"], ["tf#/"], ["tf#/world/stations"], None], type=pa.list_(pa.string()))
    expected = [["a.left.head"], ["tf#/a"], ["tf#/a/world/stations"], None]
    assert _renamed(names, "a", _frame).to_pylist() == expected


def test_the_colour_of_the_track_shows_its_range() -> None:
    lightness = [sum(range_colour(r)) for r in np.linspace(0.0, 600.0, 25)]
    assert all(a > b for a, b in itertools.pairwise(lightness))
    assert range_colour(2000.0) == RANGE_COLOURS[-1]


def test_what_an_argument_is(tmp_path: Path) -> None:
    for name, kind in (("session.toml", SourceKind.SESSION), ("track.csv", SourceKind.RESULTS)):
        folder = tmp_path / name.split(".")[0]
        folder.mkdir()
        (folder / name).write_text("")
        assert source_kind(folder) is kind
    (tmp_path / "a.mcap").write_bytes(b"")
    assert source_kind(tmp_path / "a.mcap") is SourceKind.SESSION
    for wrong in (tmp_path, tmp_path / "none", tmp_path / "session" / "session.toml"):
        with pytest.raises(InputError, match="wanted a session folder"):
            source_kind(wrong)


def test_runs_have_names_of_their_own(tmp_path: Path) -> None:
    sources = []
    for day in ("mon", "tue"):
        for name in ("out 1", "out.2"):
            folder = tmp_path / day / name
            folder.mkdir(parents=True)
            (folder / "track.csv").write_text("")
            sources.append(folder)
    assert [r.name for r in plan_runs(sources[:2])] == ["out-1", "out-2"]
    assert [r.name for r in plan_runs(sources)] == ["mon-out-1", "mon-out-2", "tue-out-1", "tue-out-2"]
    assert [r.name for r in plan_runs([sources[0]] * 3)] == [f"mon-out-1{e}" for e in ("", "-2", "-3")]
    config = tmp_path / "soft.toml"
    config.write_text("")
    with pytest.raises(InputError, match="--config"):
        plan_runs(sources, [config])
    (sources[0] / "session.toml").write_text("")
    named = plan_runs(sources[:1], [config, config])
    assert [r.name for r in named] == ["soft", "soft-2"]
    assert all(r.config == config for r in named)
    assert replace(named[0], name="soft-2") == named[1]


def test_view_without_a_display_reports_it_before_it_replays(
    two: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert main(["view", str(two[0])]) == 1
    assert "no display: --web" in capsys.readouterr().err
    saved = tmp_path / "kept" / "one.rrd"
    assert main(["view", str(two[0]), "--save", str(saved)]) == 0
    assert saved.read_bytes() == (two[0] / "session.rrd").read_bytes()


def test_a_browser_is_served_from_this_machine_alone() -> None:
    command = web_viewer_command(Path("a.rrd"), 1, 2)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
