"""The messages of `live` at its end, its exit code, and the advice where its display cannot be shown."""

import signal
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from groundstation.cli.live import _result_text
from groundstation.cli.main import main
from groundstation.live.command import LiveRequest, LiveResult
from groundstation.live.operation import OperationResult
from groundstation.live.operator_screen import open_screen
from groundstation.live.out_folder import written_files
from groundstation.live.shutdown import Shutdown
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.simulation.standard_cases import standard_rig
from groundstation.viewer.viewer_process import ViewerError


def ended(*, epochs: int = 40, tracked: int = 20, p50_ms: float = 9.0, tracking_p50_ms: float = 7.5) -> LiveResult:
    """An operation's end; delays of 0 are those of nothing."""
    return LiveResult(
        operation=OperationResult(
            elapsed_s=10.0,
            epochs=epochs,
            tracked=tracked,
            latency_p50_ms=p50_ms,
            latency_p99_ms=2.0 * p50_ms,
            tracking_p50_ms=tracking_p50_ms,
            tracking_p99_ms=2.0 * tracking_p50_ms,
            dropped={},
            counts={},
            busy_s=1.0,
        ),
        files=(),
    )


def test_latency_of_no_pairs_is_not_printed() -> None:
    """Expected: a line for what was measured; none, rather than 0.0 ms, where nothing was tracked or nothing came."""
    assert "the same while tracking: median 7.5 ms, 99 % within 15.0 ms" in _result_text(ended())
    never = _result_text(ended(tracked=0, tracking_p50_ms=0.0))
    assert "its answer: median 9.0 ms, 99 % within 18.0 ms" in never
    assert "while tracking" not in never
    nothing = _result_text(ended(epochs=0, tracked=0, p50_ms=0.0, tracking_p50_ms=0.0))
    assert nothing.startswith("0 pairs in 10.0 s, tracking in 0.0 % of them\nthe pipeline computed")
    assert " 0.0 ms" not in nothing


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
def test_without_a_display_it_names_an_option_that_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    request = LiveRequest(station=None, out=tmp_path / "out", screen="desktop")
    file = simulated_station_file(tmp_path, 30.0, None)
    with ExitStack() as opened, pytest.raises(ViewerError, match="no display for --view; --web shows the same"):
        open_screen(request.screen, standard_rig(), file, opened, Shutdown(lambda: False), [], [], lambda _: None)


@pytest.mark.parametrize("lost", [False, True])
def test_without_a_recording_the_exit_code_is_an_error(
    lost: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: 1 and a line where a recording was wanted and nothing of it is there; 0 where only some of it lacks."""
    why = "flight.mcap: failed: the disk accepted no data at the end (disk full, 12 MB free)"
    result = replace(ended(), incomplete=(why,), lost=lost)
    monkeypatch.setattr("groundstation.live.command.live", lambda *_, **__: result)
    assert main(["live", "--simulate", "--out", "x"]) == int(lost)
    reported = capsys.readouterr()
    assert f"not whole: {why}" in reported.out
    assert reported.err == ("groundstation: nothing could be recorded\n" if lost else "")


@pytest.mark.parametrize(
    ("epochs", "tracked", "behind", "words"),
    [
        (0, 0, 0, "no track: no pair of pictures came"),
        (40, 0, 30, "no track: the computer was behind, and 30 pairs were dropped: try a lower --rate"),
        (40, 0, 3, "no track: in none of 40 pairs (4.0 per s) was the aircraft found by both cameras"),
        (40, 1, 3, "hardly any track: in 1 of 40 pairs (4.0 per s) was the aircraft found by both cameras"),
        (10, 0, 0, "no track: 1.0 pairs per s are too few to find and hold an aircraft: end other programs"),
    ],
)
def test_a_simulated_flight_without_a_track_says_why_and_exits_with_1(
    epochs: int,
    tracked: int,
    behind: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = ended(epochs=epochs, tracked=tracked)
    operation = replace(result.operation, dropped={"pairs, being behind": behind} if behind else {})
    monkeypatch.setattr("groundstation.live.command.live", lambda *_, **__: replace(result, operation=operation))
    assert main(["live", "--simulate", "--out", "x"]) == 1
    reported = capsys.readouterr().err
    assert words in reported
    assert len(reported.splitlines()) == 1


def test_a_flight_too_short_to_be_found_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    result = ended(epochs=4, tracked=0)
    operation = replace(result.operation, elapsed_s=2.0)
    monkeypatch.setattr("groundstation.live.command.live", lambda *_, **__: replace(result, operation=operation))
    assert main(["live", "--simulate", "--out", "x"]) == 0


def test_simulated_pictures_that_did_not_come_are_counted() -> None:
    assert "did not come (not rendered in time, or a fault's): 17" in _result_text(ended(), missing=17)
    assert "did not come" not in _result_text(ended())


def test_a_lost_process_of_the_heads_is_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: though it was restarted, and all files are whole; a line each."""
    lines = ("12.0 s: the PTUs' process was ended by SIGKILL", "14.0 s: left: no halt was acknowledged")
    result = replace(ended(), losses=lines)
    monkeypatch.setattr("groundstation.live.command.live", lambda *_, **__: result)
    assert main(["live", "--simulate", "--out", "x"]) == 1
    assert capsys.readouterr().err == "".join(f"groundstation: {line}\n" for line in lines)


def test_a_file_of_no_bytes_is_not_listed(tmp_path: Path) -> None:
    (tmp_path / "flight.mcap").touch()
    (tmp_path / "track.csv").write_text("t_s\n", encoding="utf-8")
    (tmp_path / "ptu-left").symlink_to("/dev/pts/none")
    assert written_files(tmp_path) == (tmp_path / "track.csv",)


def test_interrupted_before_a_pair_has_come_is_told_as_that(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: not that there was no track, which the user did not wait for."""

    def interrupted(*_: object, **__: object) -> LiveResult:
        signal.raise_signal(signal.SIGINT)
        return ended(epochs=0, tracked=0)

    monkeypatch.setattr("groundstation.live.command.live", interrupted)
    assert main(["live", "--simulate", "--out", "x"]) == 130
    assert capsys.readouterr().err == "groundstation: interrupted; no pair of pictures had come\n"
