import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.messages import Frame
from groundstation.session import load_session
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.ptu_readings import PtuReadings
from groundstation.sources.reading_gaps import ReadingGaps, gap_notes
from tests.complaints import complaint
from tests.session.folder import Tiny


def opened(folder: Path, from_s: float = -1e9, to_s: float = 1e9, **tiny: object) -> PtuReadings:
    readings = PtuReadings(load_session(Tiny(rows=1, video="png", **tiny).write(folder)))
    readings.start(from_s, to_s)
    return readings


def test_readings_are_handed_out_once_and_in_order(tmp_path: Path) -> None:
    readings = opened(tmp_path)
    first = list(readings.until(1.0))
    rest = list(readings.until(1e9))
    times = [r.t_s for r in (*first, *rest)]
    assert times == sorted(times)
    assert len(times) == 2 * 37
    assert max(r.t_s for r in first) == 1.0
    assert readings.newest_s == times[-1]
    assert not readings.ended_before(1e9)
    assert list(readings.until(1e9)) == []


@pytest.mark.parametrize("offset_s", [0.0, 0.02, -0.33, 1.7])
def test_clocks_that_differ_give_one_ordered_stream(tmp_path: Path, offset_s: float) -> None:
    clock = {"right": f"ptu_clock = {{ offset_s = {offset_s}, drift_ppm = 500.0 }}"}
    times = [r.t_s for r in opened(tmp_path, rig_more=clock).until(1e9)]
    assert times == sorted(times)
    assert len(times) == 2 * 37


@pytest.mark.parametrize(
    ("offset_s", "got"),
    [(1.7e9, "left at 0.7 s and right at 1700000000.7 s"), (-1.7e9, "right at -1699999999.3 s and left at 0.7 s")],
)
def test_a_clock_that_takes_one_station_away_is_named(tmp_path: Path, offset_s: float, got: str) -> None:
    """Expected: as where the offset to an epoch is stated of one station."""
    clock = {"right": f"ptu_clock = {{ offset_s = {offset_s} }}"}
    reported = complaint(SessionError, lambda: opened(tmp_path, rig_more=clock))
    assert reported == f"ptu.csv: line 2: got {got} by their ptu_clock; wanted at most 3600 s between them"


def test_it_starts_at_the_requested_time(tmp_path: Path) -> None:
    assert next(opened(tmp_path, from_s=1.01).until(1e9)).t_s == pytest.approx(1.05)


def test_a_time_that_is_not_covered(tmp_path: Path) -> None:
    reported = complaint(SessionError, lambda: opened(tmp_path, from_s=5.0, to_s=6.0))
    assert (
        reported
        == "ptu.csv: got readings from 0.7 to 2.5 s; wanted readings around the frames, 5 to 6 s of the session's clock"
    )


def test_angles_that_no_head_has_are_named(tmp_path: Path) -> None:
    """Expected: the stream ends before the row, and the fault names line, station, angle and unit."""
    session = load_session(Tiny(rows=1, video="png").write(tmp_path))
    lines = (tmp_path / "ptu.csv").read_text(encoding="utf-8").splitlines()
    cells = lines[3].split(",")
    lines[3] = ",".join([cells[0], "123456", "7", *cells[3:]])
    (tmp_path / "ptu.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    readings = PtuReadings(session)
    readings.start(-1e9, 1e9)
    assert len(list(readings.until(1e9))) == 2 * 2
    assert str(readings.fault).startswith(
        "ptu.csv: line 4: got left at 123456 deg, as of an encoder's counts, or thousandths of degrees; "
        "wanted angles in degrees, at most 3600"
    )


def test_a_long_table_is_streamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: by the tenth frame, hardly more rows are read than there are before it."""
    folder = Tiny(rows=12, ptu_from_s=0.9, ptu_to_s=2000.0).write(tmp_path)
    rows = 0
    real = CsvTable.__iter__

    def counted(table: CsvTable) -> Iterator[Row]:
        nonlocal rows
        for row in real(table):
            rows += table.path.name == "ptu.csv"
            yield row

    monkeypatch.setattr(CsvTable, "__iter__", counted)
    with FolderSource(load_session(folder)) as source:
        frames = (e for e in source if isinstance(e, Frame))
        assert len(list(itertools.islice(frames, 10))) == 10
        assert rows < 20
        assert len(list(frames)) == 14
    assert rows < 50


@pytest.mark.parametrize(
    ("without", "span_s", "notes"),
    [
        (lambda t_s, name: False, (0.6, 2.6), []),
        (
            lambda t_s, name: 1.22 < t_s < 1.88,
            (1.0, 2.0),
            ["ptu.csv: no readings of left and right from 1.20 to 1.90 s: pictures have no angles there"],
        ),
        (
            lambda t_s, name: name == "left" and t_s > 1.52,
            (1.0, 2.0),
            ["ptu.csv: no readings of left from 1.50 to 2.00 s: pictures have no angles there"],
        ),
        (
            lambda t_s, name: name == "right",
            (1.0, 2.0),
            ["ptu.csv: no readings of right from 1.00 to 2.00 s: pictures have no angles there"],
        ),
    ],
)
def test_stretches_without_readings_are_noted(
    tmp_path: Path, without: Callable[[float, str], bool], span_s: tuple[float, float], notes: list[str]
) -> None:
    """Expected: as where a log was cut, ended early, or has an empty column."""
    folder = Tiny(rows=1, video="png").write(tmp_path)
    head, *rows = (folder / "ptu.csv").read_text().split()
    cut = []
    for cells in (row.split(",") for row in rows):
        for k, name in ((1, "left"), (3, "right")):
            if without(float(cells[0]), name):
                cells[k : k + 2] = ["", ""]
        cut.append(",".join(cells))
    (folder / "ptu.csv").write_text("\n".join([head, *cut]) + "\n")
    readings = PtuReadings(load_session(folder))
    readings.start(-1e9, 1e9)
    list(readings.until(1e9))
    assert readings.notes(span_s, 0.25) == notes


def test_of_many_stretches_the_longest_are_named() -> None:
    gaps = ReadingGaps()
    for k in range(100):
        gaps.add(float(k))
    gaps.add(104.0)
    notes = gap_notes({"left": gaps}, "ptu.csv", (0.0, 108.0), 0.5)
    assert notes == [
        "ptu.csv: no readings of left from 99.00 to 104.00 s: pictures have no angles there",
        "ptu.csv: no readings of left from 104.00 to 108.00 s: pictures have no angles there",
        "ptu.csv: 19 or more other stretches of over 0.5 s without readings",
    ]


def test_pictures_that_end_early_are_no_gap_in_the_readings(tmp_path: Path) -> None:
    """Expected: no note on what was not read, as the fault of the pictures speaks for it."""
    folder = Tiny(rows=40, video="png").write(tmp_path)
    for path in (folder / "left").glob("*.png"):
        if int(path.stem) >= 10:
            path.unlink()
    taken = []
    with FolderSource(load_session(folder)) as source:
        with pytest.raises(SessionError, match="no picture number 10"):
            taken.extend(source)
        assert len(taken) > 10
        assert source.notes(0.25) == []
