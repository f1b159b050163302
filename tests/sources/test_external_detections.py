from pathlib import Path

import numpy as np
import pytest

from groundstation.messages import PixelMeasurement
from groundstation.session import load_session
from groundstation.sources.external_detections import rowless_notes
from groundstation.sources.folder_source import FolderSource
from tests.session.folder import SESSION, Tiny, edit_line, rig_text
from tests.sources.events import Played, play

NAMES = ("north", "east", "south")
CLOCKS = (
    "\n[clocks]\nnorth = { offset_s = 60.0 }\neast = { offset_s = 50.0, sigma_s = 0.3 }\nsouth = { offset_s = 55.5 }\n"
)
OFFSETS = {"north": 60.0, "east": 50.0, "south": 55.5}


def labelled(folder: Path, *, mixed: bool = False) -> Path:
    """Three fixed cameras at 50, 25 and 30 Hz in clocks of their own, all seeing session times 100 to 102 s."""
    Tiny(names=NAMES, fixed=NAMES, rows=1, video="none", session=SESSION + CLOCKS).write(folder)
    (folder / "frames.csv").unlink()
    rows: list[tuple[float, str]] = []
    for name, rate in zip(NAMES, (50, 25, 30), strict=True):
        for t in np.arange(100.0, 102.0, 1.0 / rate):
            own = t - OFFSETS[name]
            rows.append((t, f"{own:.6f},{name},{10 * (t - 100):.4f},{rate}"))
    if mixed:
        rows.sort()
    (folder / "detections.csv").write_text("\n".join(["t_s,station,u_px,v_px", *(text for _, text in rows)]) + "\n")
    return folder


def check(played: Played) -> None:
    assert not played.fault
    played_times = [e.t_s for e in played.events]
    assert played_times == sorted(played_times)
    assert all(p.u_px == pytest.approx(10 * (p.t_s - 100), abs=1e-3) for p in played.pixels)


def test_stations_one_after_the_other_or_mixed_are_the_same(tmp_path: Path) -> None:
    grouped, mixed = play(labelled(tmp_path / "a")), play(labelled(tmp_path / "b", mixed=True))
    check(grouped)
    assert grouped.events == mixed.events
    assert [sum(p.station == n for p in grouped.pixels) for n in NAMES] == [100, 50, 60]


def test_an_epoch_at_each_stamp_of_the_first_station(tmp_path: Path) -> None:
    played = play(labelled(tmp_path))
    stamps = [p.t_s for p in played.pixels if p.station == "north"]
    assert [e.t_s for e in played.epochs] == stamps
    assert [e.epoch for e in played.epochs] == list(range(100))
    assert all(e.stations == NAMES for e in played.epochs)
    # each pixel belongs to the first epoch that is not before it; after the last there is only that one
    for pixel in played.pixels:
        later = [e.epoch for e in played.epochs if e.t_s >= pixel.t_s - 1e-9]
        assert pixel.epoch == (later[0] if later else played.epochs[-1].epoch)


def pixels(*spans_s: tuple[float, float]) -> np.ndarray:
    t = np.concatenate([np.arange(first, last, 0.1) for first, last in spans_s])
    return np.column_stack([t, np.zeros((len(t), 4))])


@pytest.mark.parametrize(
    ("first", "words"),
    [
        (pixels((0.0, 8.05)), "8.0 to 20.0 s (238 pixels of others)"),
        (pixels((8.05, 20.0)), "0.0 to 8.1 s (160 pixels of others)"),
        (pixels((0.0, 5.0), (10.0, 20.0)), "4.9 to 10.0 s (100 pixels of others)"),
    ],
)
def test_where_the_first_station_has_no_pixels_a_note_says_that_rows_are_missing(first: np.ndarray, words: str) -> None:
    """Rows are at the first station's stamps: two cameras that go on without it had none, and nothing said so."""
    (note,) = rowless_notes({"north": first, "east": pixels((0.0, 20.05)), "south": pixels((0.0, 20.05))}, "north")
    assert note.startswith(f"north: without a pixel {words}: ")
    assert "list a station that has pixels first in rig.toml" in note


def test_some_frames_without_a_pixel_are_no_note() -> None:
    missed = pixels((0.0, 5.0), (6.9, 20.0))
    assert not rowless_notes({"north": missed, "east": pixels((0.0, 20.0))}, "north")
    assert not rowless_notes({"north": missed}, "north")
    # none of the others has any there, either
    assert not rowless_notes({"north": missed, "east": pixels((0.0, 5.0), (9.0, 20.0))}, "north")


def test_an_epoch_follows_every_pixel_of_its_instant(tmp_path: Path) -> None:
    events = play(labelled(tmp_path)).events
    pixels = [e for e in events if isinstance(e, PixelMeasurement)]
    for place, event in enumerate(events):
        if not isinstance(event, PixelMeasurement):
            before = [e for e in events[:place] if isinstance(e, PixelMeasurement)]
            assert before == [e for e in pixels if e.t_s <= event.t_s]
            assert ("north", event.t_s) in {(e.station, e.t_s) for e in before}


def test_a_part_in_session_time(tmp_path: Path) -> None:
    folder = labelled(tmp_path)
    with FolderSource(load_session(folder), 100.5, 101.0) as source:
        assert source.span_s == pytest.approx((100.5, 101.0), abs=0.021)
        assert source.epoch_count in (25, 26)
        assert all(100.5 <= e.t_s <= 101.0 for e in source)
    assert "detections.csv: got times from 100 to 101.98 s; wanted some from 103 s on" in play(folder, 103.0).fault


def test_the_first_station_with_pixels_leads(tmp_path: Path) -> None:
    folder = labelled(tmp_path)
    lines = [row for row in (folder / "detections.csv").read_text().splitlines() if "north" not in row]
    (folder / "detections.csv").write_text("\n".join(lines))
    played = play(folder)
    check(played)
    assert len(played.epochs) == 50


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("44.0,west,1,1", "got station 'west'; wanted one of north, east, south"),
        ("40.0,north,1,1", "got t_s = 40, an earlier time than the row before; wanted later than 40.16"),
        ("40.18,north,nan,1", "got u_px = 'nan'; wanted a finite number"),
        ("40.18,north,,1", "got an empty u_px; wanted a finite number"),
        ("40.18;north;1;1", "got 1 cells; wanted 4 as in the header"),
    ],
)
def test_a_bad_row_ends_the_reading_there(tmp_path: Path, row: str, message: str) -> None:
    folder = labelled(tmp_path)
    edit_line(folder / "detections.csv", 11, row)
    played = play(folder)
    assert played.fault == f"detections.csv: line 11: {message}"
    assert len(played.pixels) == 9


def test_a_pixel_far_ahead_is_left_out(tmp_path: Path) -> None:
    """Expected: neither the row ahead nor the one after it, which is at fault, is an epoch."""
    folder = labelled(tmp_path)
    edit_line(folder / "detections.csv", 10, "9999,north,1,1")
    played = play(folder)
    assert played.fault == (
        "detections.csv: line 11: got t_s = 40.18, an earlier time than the row before; wanted later than 9999"
    )
    assert [p.t_s for p in played.pixels][-1] == pytest.approx(100.14)
    assert len(played.epochs) == 8


def test_rows_of_stations_that_the_rig_leaves_out_are_passed_over(tmp_path: Path) -> None:
    folder = labelled(tmp_path / "a")
    (tmp_path / "two.toml").write_text(rig_text(("east", "south"), ("east", "south")))
    with FolderSource(load_session(folder, tmp_path / "two.toml")) as source:
        events = list(source)
    kept = [e for e in play(folder).pixels if e.station != "north"]
    pixels = [e for e in events if isinstance(e, PixelMeasurement)]
    assert [(e.station, e.t_s, e.u_px) for e in pixels] == [(e.station, e.t_s, e.u_px) for e in kept]
    assert len(events) - len(pixels) == 50


def test_nothing_usable(tmp_path: Path) -> None:
    folder = labelled(tmp_path)
    (folder / "detections.csv").write_text("t_s,station,u_px,v_px\n")
    assert "detections.csv: got no row with a time; wanted at least one" in play(folder).fault
    (folder / "detections.csv").write_text("t_s,station,u_px\n")
    assert "detections.csv: line 1: got t_s, station, u_px; wanted a column v_px" in play(folder).fault


def test_every_row_of_a_real_recording(shared_data: Path) -> None:
    folder = shared_data / "drone-flight-3"
    rows = len((folder / "detections.csv").read_text().splitlines()) - 1
    played = play(folder)
    assert not played.fault
    assert len(played.pixels) == rows == 63_786
    times = np.array([e.t_s for e in played.events])
    assert np.all(np.diff(times) >= 0)
    leader = [p for p in played.pixels if p.station == "gopro3"]
    assert len(played.epochs) == len(leader)
    assert leader[0].t_s == pytest.approx(0.016683 + 61.95)


def with_sigmas(folder: Path, cells: str) -> Path:
    """The table with columns of sigma, the first row's as given and the others' empty."""
    lines = (labelled(folder) / "detections.csv").read_text().splitlines()
    rows = [lines[0] + ",sigma_u_px,sigma_v_px", lines[1] + "," + cells, *(line + ",," for line in lines[2:])]
    (folder / "detections.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_a_pixel_carries_the_sigma_of_its_row(tmp_path: Path) -> None:
    pixels = play(with_sigmas(tmp_path, "0.25,1.5")).pixels
    assert pixels[0].sigma_px == (0.25, 1.5)
    assert {pixel.sigma_px for pixel in pixels[1:]} == {None}


@pytest.mark.parametrize("cells", ["0.25,", "0.0,1.0", "1.0,-1.0"])
def test_a_sigma_that_is_none_is_refused(tmp_path: Path, cells: str) -> None:
    played = play(with_sigmas(tmp_path, cells))
    assert "detections.csv: line 2" in str(played.fault)
    assert "wanted both > 0, or both empty" in str(played.fault)
