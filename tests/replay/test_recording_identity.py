"""Replaying a recording gives the track that was recorded, bit for bit; and missing data are reported."""

import json
import subprocess
import sysconfig
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.recording.event_codec import line
from groundstation.recording.mcap_metadata import TRACK_TOPIC
from groundstation.recording.mcap_reader import McapReader
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.sinks.output_comparison import OutputComparisonSink

pytestmark = pytest.mark.usefixtures("unrendered_figures")

FROM_S, TO_S = 21.0, 22.7


@pytest.fixture(scope="module")
def recorded(landing_from_20_s: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some seconds of the landing, with DGPS for the first, replayed into out/ and recorded."""
    folder = tmp_path_factory.mktemp("recorded")
    request = ReplayRequest(
        session=landing_from_20_s,
        out=folder / "out",
        from_s=FROM_S,
        to_s=TO_S,
        learn_until_s=FROM_S + 1.0,
        rerun=False,
        report=False,
        record=folder / "flight.mcap",
    )
    assert replay(request).fault is None
    return folder


def test_the_same_track_bit_for_bit(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = recorded / "again"
    assert main(["replay", str(recorded / "flight.mcap"), "--out", str(again), "--no-rerun"]) == 0
    for name in ("track.csv", "triangulation.csv", "track.tum"):
        assert (again / name).read_bytes() == (recorded / "out" / name).read_bytes()
    reported = capsys.readouterr().out
    epochs = len((again / "track.csv").read_text().splitlines()) - 1
    assert f"the same track as was recorded, bit for bit: {epochs} epochs\n" in reported
    summary = json.loads((again / "summary.json").read_text())
    assert "tracking" in (again / "track.csv").read_text()
    first = json.loads((recorded / "out" / "summary.json").read_text())
    # truth, DGPS and the parameters estimated from it are in the recording
    assert summary["calibration"] == first["calibration"]


def test_only_the_read_windows_are_recorded(recorded: Path) -> None:
    whole = parts = part_bytes = 0
    with McapReader(recorded / "flight.mcap") as reader:
        for message in reader.messages():
            if message.topic.endswith("/image"):
                whole += 1
            elif "/window/" in message.topic:
                parts += 1
                part_bytes += len(message.data)
    assert 0 < whole < parts
    assert part_bytes / parts < 150_000


def test_rerun_opens_it(recorded: Path) -> None:
    rerun = Path(sysconfig.get_path("scripts")) / "rerun"
    out = recorded / "seen.rrd"
    environment = {"RERUN_ANALYTICS": "0", "HOME": str(recorded), "PATH": "/usr/bin:/bin"}
    command = [rerun, "mcap", "convert", recorded / "flight.mcap", "-o", out]
    subprocess.run(command, check=True, capture_output=True, env=environment)
    subprocess.run([rerun, "rrd", "verify", out], check=True, capture_output=True, env=environment)
    stats = subprocess.run(
        [rerun, "rrd", "stats", out], check=True, capture_output=True, text=True, env=environment
    ).stdout
    # its exit code alone is not sufficient: the content counts
    for entity in ("/tf", "/track/pose", "/log", "/groundstation/events"):
        assert f"\n{entity}: " in stats
    for station in ("left", "right"):
        for entity in ("image", "window/0", "calibration"):
            assert f"\n/stations/{station}/{entity}: " in stats


def test_answers_that_differ_are_counted(recorded: Path) -> None:
    with McapReader(recorded / "flight.mcap") as reader:
        answers = [m.data for m in reader.messages() if m.topic == TRACK_TOPIC]
    check = OutputComparisonSink()
    for k, answer in enumerate(answers):
        values = json.loads(answer)
        check.recorded(answer)
        del values["latency_s"]
        if k == 3:
            values["t_s"] += 1e-12
        check._meet(check._answered, check._recorded, values["epoch"], line(values))
    result = check.result()
    epoch = json.loads(answers[3])["epoch"]
    assert (result.compared, result.differing, result.first_epoch, result.alone) == (len(answers), 1, epoch, 0)
    assert f"the first that differs is epoch {epoch}" in result.line()


@pytest.mark.parametrize("wider", [True, False])
def test_another_tuning_uses_the_recorded_pixels(recorded: Path, tmp_path: Path, wider: bool) -> None:
    """Expected: pixels next to the recorded ones are not used; the aircraft is tracked, and nothing fails."""
    tuning = tmp_path / "tuning.toml"
    tuning.write_text(f"[detection]\nroi_basic_px = {[220, 140] if wider else [70, 50]}\n", encoding="utf-8")
    request = ReplayRequest(
        session=recorded / "flight.mcap",
        out=tmp_path / "out",
        config=tuning,
        rerun=False,
        report=False,
    )
    result = replay(request)
    assert result.fault is None
    assert result.output_comparison is None
    first = json.loads((recorded / "out" / "summary.json").read_text())["counts"]["detection"]
    again = result.evaluation.summary["counts"]["detection"]
    for station, counts in again.items():
        assert counts["status"]["ok"] >= 0.9 * first[station]["status"]["ok"], (counts, first[station])


def test_started_where_only_parts_were_recorded_no_target_is_found_without_an_error(
    recorded: Path, tmp_path: Path
) -> None:
    """Expected: the whole picture, which a search needs, was not recorded; every detection has that reason."""
    request = ReplayRequest(
        session=recorded / "flight.mcap", out=tmp_path, from_s=TO_S - 0.5, rerun=False, report=False
    )
    result = replay(request)
    assert result.fault is None
    for counts in result.evaluation.summary["counts"]["detection"].values():
        assert counts["status"]["ok"] == 0
        assert counts["miss_reason"]["not_recorded"] == counts["status"]["miss"] > 0


def test_a_part_or_another_tuning_is_not_compared(recorded: Path, tmp_path: Path) -> None:
    request = ReplayRequest(
        session=recorded / "flight.mcap", out=tmp_path, to_s=FROM_S + 1.0, rerun=False, report=False
    )
    result = replay(request)
    assert result.output_comparison is None
    assert result.fault is None
    rows = (tmp_path / "track.csv").read_text().splitlines()[1:]
    assert rows == (recorded / "out" / "track.csv").read_text().splitlines()[1 : len(rows) + 1]
