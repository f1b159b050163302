"""sightings.csv and landmarks.csv: what is written comes back, and what is wrong is named."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.sightings import MAX_PAN_DEG, MAX_TILT_DEG, read_landmarks, read_sightings, require_consistent
from groundstation.errors import InputError

HEAD = "station,landmark,pan_deg,tilt_deg,u_px,v_px"
ROW = "left,mast,10.5,-2,640.25,480"


def sightings(tmp_path: Path, *rows: str, head: str = HEAD):
    path = tmp_path / "sightings.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return read_sightings(path)


def landmarks(tmp_path: Path, *rows: str, head: str = "landmark,x_m,y_m,z_m"):
    path = tmp_path / "landmarks.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return read_landmarks(path)


def test_a_row_with_defaults(tmp_path: Path) -> None:
    (s,) = sightings(tmp_path, ROW)
    assert (s.station, s.landmark, s.sigma_px, s.t_s, s.pan_from, s.tilt_from) == ("left", "mast", 0.3, None, 0, 0)
    assert np.degrees([s.pan_rad, s.tilt_rad]) == pytest.approx([10.5, -2.0])
    assert s.pixel_px.tolist() == [640.25, 480.0]


def test_the_sense_of_motion_is_the_rows_order_of_each_station(tmp_path: Path) -> None:
    rows = ["left,a,0,0,1,1", "right,a,9,9,1,1", "left,a,5,-1,1,1", "left,a,5.01,-1.01,1,1", "left,a,1,3,1,1"]
    found = [(s.pan_from, s.tilt_from) for s in sightings(tmp_path, *rows) if s.station == "left"]
    # a change by the encoder's noise alone is no motion
    assert found == [(0, 0), (1, -1), (1, -1), (-1, 1)]


def test_optional_columns(tmp_path: Path) -> None:
    (a, b) = sightings(tmp_path, ROW + ",1.5,0.1,-1,1", ROW + ",,,,", head=HEAD + ",t_s,sigma_px,pan_from,tilt_from")
    assert (a.t_s, a.sigma_px, a.pan_from, a.tilt_from) == (1.5, 0.1, -1, 1)
    assert (b.t_s, b.sigma_px, b.pan_from, b.tilt_from) == (None, 0.3, -1, 1)


def test_landmarks_of_every_kind(tmp_path: Path) -> None:
    head = "landmark,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,kind"
    found = landmarks(tmp_path, "a,1,2,3,,,,", "b,0,3000,4000,5,,0,direction", "c,,,,,,,point", head=head)
    assert found["a"].place.tolist() == [1, 2, 3]
    assert found["a"].sigma.tolist() == [0.02] * 3
    assert found["b"].kind == "direction"
    assert found["b"].place == pytest.approx([0, 0.6, 0.8])
    assert found["b"].sigma == pytest.approx([0.001, 0, 0])
    assert found["c"].place is None


@pytest.mark.parametrize(
    ("row", "got"),
    [
        ("left,mast,x,0,1,1", "pan_deg = 'x'"),
        ("left,mast,721,0,1,1", "pan_deg = 721"),
        ("left,mast,0,181,1,1", "tilt_deg = 181"),
        ("left,mast,0,0,nan,1", "u_px = 'nan'"),
        ("left,mast,0,0,1", "5 cells"),
        (",mast,0,0,1,1", "an empty station"),
        ("left," + "m" * 65 + ",0,0,1,1", "landmark = "),
    ],
)
def test_bad_sightings_are_named(tmp_path: Path, row: str, got: str) -> None:
    with pytest.raises(InputError, match=r"sightings\.csv: line 3") as error:
        sightings(tmp_path, ROW, row)
    assert got in str(error.value)


@pytest.mark.parametrize(
    ("cell", "got"),
    [("0,1", "sigma_px = 0"), ("-1,1", "sigma_px = -1"), ("0.3,2", "pan_from = 2"), ("0.3,0", "pan_from = 0")],
)
def test_bad_optional_cells_are_named(tmp_path: Path, cell: str, got: str) -> None:
    with pytest.raises(InputError, match=r"line 2") as error:
        sightings(tmp_path, f"{ROW},{cell}", head=HEAD + ",sigma_px,pan_from")
    assert got in str(error.value)


@pytest.mark.parametrize(
    ("rows", "got"),
    [
        (["a,1,2,3,", "a,1,2,3,"], "'a' a second time"),
        (["a,1,,3,"], "2 of x_m, y_m, z_m"),
        (["a,0,0,0,direction"], "a direction of length 0"),
        (["a,1,2,3,line"], "kind = 'line'"),
        ([], "no row"),
    ],
)
def test_bad_landmarks_are_named(tmp_path: Path, rows: list[str], got: str) -> None:
    with pytest.raises(InputError, match="landmarks") as error:
        landmarks(tmp_path, *rows, head="landmark,x_m,y_m,z_m,kind")
    assert got in str(error.value)


def test_missing_files_columns_and_names(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_sightings(tmp_path / "none.csv")
    with pytest.raises(InputError, match="a column u_px"):
        sightings(tmp_path, head="station,landmark,pan_deg,tilt_deg,v_px")
    with pytest.raises(InputError, match="no row"):
        sightings(tmp_path)
    known = landmarks(tmp_path, "mast,1,2,3")
    seen = sightings(tmp_path, ROW)
    require_consistent(seen, known, ["left"], Path("sightings.csv"))
    with pytest.raises(InputError, match="line 2: got station 'left'; wanted a station of the rig: right"):
        require_consistent(seen, known, ["right"], Path("sightings.csv"))
    with pytest.raises(InputError, match="got landmark 'mast'"):
        require_consistent(seen, landmarks(tmp_path, "tower,1,2,3"), ["left"], Path("sightings.csv"))


NAMES = st.text(
    st.characters(codec="utf-8", exclude_characters='",', categories=("L", "N", "P")), min_size=1, max_size=20
)
ROWS = st.lists(
    st.tuples(NAMES, NAMES, st.floats(-720, 720), st.floats(-180, 180), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
    min_size=1,
    max_size=8,
)


@given(rows=ROWS)
def test_written_tables_are_read_back(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple]) -> None:
    path = tmp_path_factory.mktemp("s") / "sightings.csv"
    lines = [",".join([a, b, *(repr(n) for n in numbers)]) for a, b, *numbers in rows]
    path.write_text("\n".join([HEAD, *lines]), encoding="utf-8")
    for wanted, found in zip(rows, read_sightings(path), strict=True):
        numbers = [np.degrees(found.pan_rad), np.degrees(found.tilt_rad), *found.pixel_px]
        assert (found.station, found.landmark) == wanted[:2]
        assert numbers == pytest.approx(wanted[2:], rel=1e-12, abs=1e-300)


@given(text=st.one_of(st.binary(max_size=300), st.text('left,mast0123456789.-\n"', max_size=200).map(str.encode)))
def test_any_bytes_are_read_or_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, text: bytes) -> None:
    path = tmp_path_factory.mktemp("s") / "table.csv"
    for head, read in ((HEAD, read_sightings), ("landmark,x_m,y_m,z_m", read_landmarks)):
        path.write_bytes(head.encode() + b"\n" + text)
        try:
            answer = str(len(read(path)))
        except InputError as error:
            answer = str(error)
        assert answer
        assert "\n" not in answer


def test_the_ends_of_a_heads_range_belong_to_it(tmp_path: Path) -> None:
    rows = sightings(tmp_path, f"left,a,{-MAX_PAN_DEG},{-MAX_TILT_DEG},1,1", f"left,a,{MAX_PAN_DEG},{MAX_TILT_DEG},1,1")
    assert [np.degrees(s.pan_rad) for s in rows] == pytest.approx([-MAX_PAN_DEG, MAX_PAN_DEG])
    for row in (f"left,a,{MAX_PAN_DEG + 0.1},0,1,1", f"left,a,{-MAX_PAN_DEG - 0.1},0,1,1"):
        with pytest.raises(InputError, match="wanted a number from"):
            sightings(tmp_path, row)
