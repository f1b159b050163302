import os
from pathlib import Path

import pytest

from groundstation.errors import SessionError
from groundstation.session import Session, load_dgps, load_session, load_truth
from tests.complaints import complaint
from tests.session.folder import Tiny

DGPS = "t_s,x_m,y_m,z_m\n0.5,1,300,20\n0.7,1.1,296,19.8\n0.9,1.2,292,19.6\n"
TRUTH = "t_s,x_m,y_m,z_m,left_u_px,left_v_px,right_u_px,right_v_px\n1,0,300,20,31,23,,\n2,0,285,19,,,30,22\n"


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return load_session(Tiny(video="png", rows=1).write(tmp_path))


def test_no_reference_is_no_fault(session: Session) -> None:
    assert load_dgps(session) == ()
    assert load_truth(session) is None


def test_dgps_with_and_without_its_own_sigma(session: Session) -> None:
    (session.folder / "dgps.csv").write_text(DGPS)
    fixes = load_dgps(session)
    assert [f.t_s for f in fixes] == [0.5, 0.7, 0.9]
    assert fixes[1].position_runway_m.tolist() == [1.1, 296.0, 19.8]
    assert fixes[1].sigma_m is None
    text = "t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,status\n1,0,0,0,0.01,0.01,0.02,fixed\n2,0,0,0,,,,\n"
    (session.folder / "dgps.csv").write_text(text)
    first, second = load_dgps(session)
    assert first.sigma_m is not None
    assert first.sigma_m.tolist() == [0.01, 0.01, 0.02]
    assert (first.status, second.status, second.sigma_m) == ("fixed", "", None)


def test_truth_with_pixels_where_the_nose_is_visible(session: Session) -> None:
    (session.folder / "truth.csv").write_text(TRUTH)
    truth = load_truth(session)
    assert truth is not None
    assert truth.t_s.tolist() == [1.0, 2.0]
    assert truth.position_runway_m[1].tolist() == [0.0, 285.0, 19.0]
    assert truth.visible["left"].tolist() == [True, False]
    assert truth.pixels_px["right"].tolist() == [[0.0, 0.0], [30.0, 22.0]]


def test_truth_without_pixels(session: Session) -> None:
    (session.folder / "truth.csv").write_text("t_s,x_m,y_m,z_m\n1,0,300,20\n")
    truth = load_truth(session)
    assert truth is not None
    assert truth.visible == {}


BROKEN = [
    ("0.7,", "0.3,", "line 3: got t_s = 0.3, an earlier time than the row before; wanted later than 0.5"),
    ("0.7,", "0.5,", "line 3: got t_s = 0.5, the same time as the row before; wanted later than 0.5"),
    ("0.7,", "nan,", "line 3: got t_s = 'nan'; wanted a finite number"),
    ("0.7,", ",", "line 3: got an empty t_s; wanted a finite number"),
    ("296", "two", "line 3: got y_m = 'two'; wanted a finite number"),
    ("296", "", "line 3: got an empty y_m; wanted a finite number"),
    ("19.8", "19.8,5", "line 3: got 5 cells; wanted 4 as in the header"),
]


@pytest.mark.parametrize(("old", "new", "message"), BROKEN)
@pytest.mark.parametrize("name", ["dgps", "truth"])
def test_a_broken_reference_reports_its_place_and_keeps_the_rows_before(
    session: Session, name: str, old: str, new: str, message: str
) -> None:
    (session.folder / f"{name}.csv").write_text(DGPS.replace(old, new, 1))
    read = load_dgps if name == "dgps" else load_truth
    assert complaint(SessionError, lambda: read(session)) == f"{name}.csv: {message}"
    faults: list[SessionError] = []
    if name == "dgps":
        assert [f.t_s for f in load_dgps(session, faults.append)] == [0.5]
    else:
        truth = load_truth(session, faults.append)
        assert truth is not None
        assert truth.t_s.tolist() == [0.5]
    assert [str(f) for f in faults] == [f"{name}.csv: {message}"]


@pytest.mark.parametrize("content", ["", "t_s,x_m,y_m\n1,2,3\n"])
def test_a_reference_without_its_columns_is_not_there(session: Session, content: str) -> None:
    for name in ("dgps", "truth"):
        (session.folder / f"{name}.csv").write_text(content)
    faults: list[SessionError] = []
    assert load_dgps(session, faults.append) == ()
    assert load_truth(session, faults.append) is None
    assert [str(f).split(":")[0] for f in faults] == ["dgps.csv", "truth.csv"]


def test_a_sigma_that_is_none(session: Session) -> None:
    text = "t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\n1,0,0,0,0.01,0,0.02\n"
    (session.folder / "dgps.csv").write_text(text)
    reported = complaint(SessionError, lambda: load_dgps(session))
    assert reported == "dgps.csv: line 2: got a sigma of 0 m; wanted sigmas > 0"


def test_half_a_sigma_and_half_a_pixel_are_faults(session: Session) -> None:
    (session.folder / "dgps.csv").write_text("t_s,x_m,y_m,z_m,sigma_x_m\n1,0,0,0,0.01\n")
    reported = complaint(SessionError, lambda: load_dgps(session))
    assert reported == "dgps.csv: line 1: got sigma_x_m; wanted all of sigma_x_m, sigma_y_m, sigma_z_m, or none"
    (session.folder / "dgps.csv").write_text("t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\n1,0,0,0,0.01,,0.1\n")
    reported = complaint(SessionError, lambda: load_dgps(session))
    assert reported == "dgps.csv: line 2: got 2 sigmas; wanted three, or three empty cells"
    (session.folder / "truth.csv").write_text(TRUTH.replace("31,23", "31,"))
    reported = complaint(SessionError, lambda: load_truth(session))
    assert reported == "truth.csv: line 2: got only one of left_u_px and left_v_px; wanted both, or neither"
    (session.folder / "truth.csv").write_text(TRUTH.replace("right_v_px", "v"))
    reported = complaint(SessionError, lambda: load_truth(session))
    assert reported == "truth.csv: line 1: got only one of right_u_px and right_v_px; wanted both, or neither"


def test_clocks_of_the_references(tmp_path: Path) -> None:
    text = "[clocks]\ndgps = { offset_s = 18.0 }\ntruth = { offset_s = -0.5 }\n"
    session = load_session(Tiny(video="png", rows=1, session=text).write(tmp_path))
    (tmp_path / "dgps.csv").write_text(DGPS)
    (tmp_path / "truth.csv").write_text(TRUTH)
    assert load_dgps(session)[0].t_s == 18.5
    truth = load_truth(session)
    assert truth is not None
    assert truth.t_s.tolist() == [0.5, 1.5]


@pytest.mark.parametrize("kind", ["a folder", "a link to what is not there", "a pipe or a device"])
@pytest.mark.parametrize("name", ["dgps.csv", "truth.csv"])
def test_a_reference_that_is_no_file_is_a_fault(session: Session, name: str, kind: str) -> None:
    """Expected: not passed over as if there were no reference."""
    path = Path(str(session.folder / name))
    if kind == "a folder":
        path.mkdir()
    elif kind.startswith("a link"):
        path.symlink_to(path.parent / "nothing")
    else:
        os.mkfifo(path)
    read = load_dgps if name == "dgps.csv" else load_truth
    reported = complaint(SessionError, lambda: read(session))
    assert reported == f"{name}: got {kind}; wanted a table of positions, or no such name"


def test_a_log_of_no_position_is_noted(session: Session) -> None:
    (session.folder / "dgps.csv").write_text("t_s,x_m,y_m,z_m\n")
    notes: list[str] = []
    assert load_dgps(session, on_note=notes.append) == ()
    assert notes == ["dgps.csv: no position in it: there is no DGPS to compare with"]


def test_a_truth_of_a_header_alone_is_noted(session: Session) -> None:
    (session.folder / "truth.csv").write_text("t_s,x_m,y_m,z_m\n")
    notes: list[str] = []
    assert load_truth(session, on_note=notes.append) is None
    assert notes == ["truth.csv: no position in it: there is no truth to compare with"]
