"""A part of a session has the part of its references: there and back, by clocks, and in bags."""

from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.conversion.reference_cut import cut_fixes, cut_references, session_part
from groundstation.session import load_session
from groundstation.session.references import load_dgps, load_truth
from tests.session.folder import Tiny

_DGPS = "t_s,x_m,y_m,z_m\n" + "".join(f"{k / 2:.3f},0,{300 - k},20\n" for k in range(60))
_TRUTH = "t_s,x_m,y_m,z_m\n" + "".join(f"{k / 10:.3f},0,{300 - k},20\n" for k in range(300))
# the margin of the DGPS: an offset of 3 s, and a gap of 0.5 s between two rows
_MARGIN_S = 3.5


def _session(folder: Path, more: str = "") -> Path:
    made = Tiny(rows=20, video="png").write(folder)
    (made / "dgps.csv").write_text(_DGPS, encoding="utf-8")
    (made / "truth.csv").write_text(_TRUTH, encoding="utf-8")
    with (made / "session.toml").open("a", encoding="utf-8") as file:
        file.write(more)
    return made


def _times(path: Path) -> list[float]:
    return [float(line.split(",")[0]) for line in path.read_text(encoding="utf-8").splitlines()[1:]]


def _span(path: Path) -> tuple[float, float]:
    times = _times(path)
    return times[0], times[-1]


def test_a_part_has_its_part_of_the_references(tmp_path: Path) -> None:
    """Expected: rows as they were, of the DGPS a margin more, of the truth a row more; the same from a recording."""
    first = _session(tmp_path / "first")
    packed, whole, part = tmp_path / "part.mcap", tmp_path / "whole.mcap", tmp_path / "part"
    assert main(["convert", str(first), str(packed), "--from", "1.1", "--to", "1.5"]) == 0
    assert main(["convert", str(packed), str(part)]) == 0
    assert _span(part / "dgps.csv") == (0.0, 5.0)
    assert _span(part / "truth.csv") == (1.0, 1.6)
    for name, text in (("dgps.csv", _DGPS), ("truth.csv", _TRUTH)):
        assert (part / name).read_text(encoding="utf-8").partition("\n")[2] in text
    session = load_session(part)
    assert len(load_dgps(session)) == 11
    assert (truth := load_truth(session)) is not None
    assert truth.t_s.size == 7
    assert main(["convert", str(first), str(whole)]) == 0
    again = tmp_path / "again"
    assert main(["convert", str(whole), str(again), "--to", "1.2"]) == 0
    assert _span(again / "dgps.csv") == (0.0, 1.2 + _MARGIN_S - 0.2)
    assert _span(again / "truth.csv") == (0.0, 1.3)


def test_each_table_is_cut_by_its_own_clock(tmp_path: Path) -> None:
    """Expected: tables whose clock is 10 s behind are cut 10 s earlier; of one that ended before nothing is left."""
    clocks = "[clocks]\ndgps = { offset_s = 10.0 }\ntruth = { offset_s = -20.0 }\n"
    first = _session(tmp_path / "first", clocks)
    packed, part = tmp_path / "part.mcap", tmp_path / "part"
    assert main(["convert", str(first), str(packed), "--from", "1.1", "--to", "1.5"]) == 0
    assert main(["convert", str(packed), str(part)]) == 0
    assert not (part / "dgps.csv").exists()
    assert _span(part / "truth.csv") == (21.0, 21.6)


def test_a_bag_of_a_part_has_its_fixes(tmp_path: Path) -> None:
    session = load_session(_session(tmp_path / "first"))
    fixes = cut_fixes(load_dgps(session), session_part(session, 6.0, 7.0))
    assert (fixes[0].t_s, fixes[-1].t_s) == (2.5, 10.5)
    assert len(cut_fixes(load_dgps(session), session_part(session, None, None))) == 60


@pytest.mark.parametrize("table", ["t_s,x_m\n1.0,2\nnone,3\n", "time,x\n1,2\n", "", "\n"])
def test_a_table_at_fault_stays_as_it_is(tmp_path: Path, table: str) -> None:
    first = _session(tmp_path / "first")
    (first / "truth.csv").write_text(table, encoding="utf-8")
    packed, part = tmp_path / "part.mcap", tmp_path / "part"
    assert main(["convert", str(first), str(packed), "--to", "1.5"]) == 0
    assert main(["convert", str(packed), str(part)]) == 0
    assert (part / "truth.csv").read_text(encoding="utf-8") == table


def test_quoted_and_blank_cells_are_cut_as_they_stand(tmp_path: Path) -> None:
    """Expected: rows byte for byte; one without a time stays between its neighbours."""
    rows = [f'"{k / 10:.3f}","0","1,5"\n' for k in range(30)]
    rows[11] = ',"0","2"\n'
    header = '"t_s","x_m","note"\n'
    session = load_session(_session(tmp_path / "first"))
    files = {"truth.csv": (header + "".join(rows)).encode(), "dgps.csv": b""}
    cut = cut_references(files, session, session_part(session, 1.0, 1.25))
    assert cut["truth.csv"].decode() == header + "".join(rows[9:14])
    assert cut["dgps.csv"] == b""
