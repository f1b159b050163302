import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import SessionError
from groundstation.files.csv_table import MAX_COLUMNS, MAX_LINE_CHARACTERS, CsvTable
from tests.complaints import complaint, only


def table(folder: Path, text: str | bytes, required: tuple[str, ...] = ("t_s", "x_m")) -> CsvTable:
    path = folder / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return CsvTable(path, required)


def fault_of(folder: Path, text: str | bytes) -> str:
    def read() -> None:
        for row in (opened := table(folder, text)):
            opened.number(row, "t_s")
            opened.number(row, "x_m")

    return complaint(SessionError, read)


def test_rows_carry_their_line_and_cells_by_name(tmp_path: Path) -> None:
    rows = list(table(tmp_path, "t_s,x_m,status\n1,2,fix\n\n3,4,\n"))
    assert [(r.line, r.text["status"]) for r in rows] == [(2, "fix"), (4, "")]


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_line_ends_byte_order_mark_spaces_and_column_order_do_not_matter(tmp_path: Path, newline: str) -> None:
    text = "\ufeff" + newline.join([" x_m , t_s ", " 2 ,1", "4, 3e0 "])
    opened = table(tmp_path, text)
    assert [(opened.number(r, "t_s"), opened.number(r, "x_m"), r.line) for r in opened] == [(1, 2, 2), (3, 4, 3)]


def test_a_table_can_be_read_again(tmp_path: Path) -> None:
    opened = table(tmp_path, "t_s,x_m\n1,2\n")
    assert list(opened) == list(opened)


@pytest.mark.parametrize("cell", ["nan", "inf", "-inf", "1e999", "1_0", "one", "0x10", "1,5"])
def test_what_is_no_finite_number_is_refused_with_its_line(tmp_path: Path, cell: str) -> None:
    message = fault_of(tmp_path, f't_s,x_m\n1,2\n2,"{cell}"\n')
    assert message == f"table.csv: line 3: got x_m = {cell!r}; wanted a finite number"


def test_an_empty_cell_is_absent_or_a_fault(tmp_path: Path) -> None:
    opened = table(tmp_path, "t_s,x_m\n1,\n")
    (row,) = opened
    assert opened.optional_number(row, "x_m") is None
    assert fault_of(tmp_path, "t_s,x_m\n1, \n") == "table.csv: line 2: got an empty x_m; wanted a finite number"


def test_a_missing_column_is_named_with_the_existing_ones(tmp_path: Path) -> None:
    expected = "table.csv: line 1: got cells separated by semicolons; wanted commas between them, and points in numbers"
    assert fault_of(tmp_path, "t_s;x_m\n1;2\n") == expected
    assert fault_of(tmp_path, "") == "table.csv: line 1: got nothing; wanted a column t_s"
    assert fault_of(tmp_path, "\n\n") == "table.csv: line 1: got nothing; wanted a column t_s"


def test_other_structural_faults(tmp_path: Path) -> None:
    assert "line 1: got two columns 'x_m'" in fault_of(tmp_path, "t_s,x_m,x_m\n")
    assert fault_of(tmp_path, "t_s,x_m\n1,2\n3\n") == "table.csv: line 3: got 1 cells; wanted 2 as in the header"
    assert "line 3: got no CSV" in fault_of(tmp_path, 't_s,x_m\n1,2\n3,"4"5\n')
    assert "line 1: got" in fault_of(tmp_path, "t_s,x_m\n1,2\n".encode("utf-16"))
    assert f"at most {MAX_COLUMNS}" in fault_of(tmp_path, "t_s,x_m" + ",a" * MAX_COLUMNS)
    assert "line 2: got a longer line" in fault_of(tmp_path, "t_s,x_m\n1," + "2" * MAX_LINE_CHARACTERS)
    assert "'\\x00'" in fault_of(tmp_path, "t_s,x_m\n1,\0\n")


def test_bytes_that_are_no_text_spoil_their_own_row_only(tmp_path: Path) -> None:
    opened = table(tmp_path, b"t_s,x_m,note\n1,2,caf\xe9\n2,\xb15,\n")
    first, second = opened
    assert opened.number(first, "x_m") == 2.0
    reported = complaint(SessionError, lambda: opened.number(second, "x_m"))
    assert reported == r"table.csv: line 3: got x_m = '\udcb15'; wanted a finite number"


def test_numbers_beyond_all_measure_and_of_other_scripts(tmp_path: Path) -> None:
    wanted = "wanted a number of at most 1e+12 in size"
    assert fault_of(tmp_path, "t_s,x_m\n1,-2e12\n") == f"table.csv: line 2: got x_m = '-2e12'; {wanted}"
    assert fault_of(tmp_path, "t_s,x_m\n1,2\n1779010218007299840,2\n").endswith(
        "in size, in seconds: neither milliseconds nor nanoseconds"
    )
    assert "line 2: got x_m = '１２'; wanted a finite number" in fault_of(tmp_path, "t_s,x_m\n1,１２\n")


def test_the_line_is_the_editors_after_a_cell_of_several_lines(tmp_path: Path) -> None:
    assert "line 4: got x_m = 'no'" in fault_of(tmp_path, 't_s,x_m\n1,"2\n"\n3,no\n')


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ((1.0, 1.0), "got t_s = 1, the same time as the row before; wanted later than 1"),
        ((1700000000.25, 1700000000.125), "t_s = 1700000000.125, an earlier time than the row before"),
    ],
)
def test_times_must_grow(tmp_path: Path, times: tuple[float, float], message: str) -> None:
    opened = table(tmp_path, f"t_s,x_m\n{times[0]!r},0\n{times[1]!r},0\n")
    first, second = opened
    before = opened.advance(first, "t_s", None)
    reported = complaint(SessionError, lambda: opened.advance(second, "t_s", before))
    assert reported.startswith("table.csv: line 3: ")
    assert message in reported


def test_a_missing_file_and_a_folder_in_its_place(tmp_path: Path) -> None:
    for path, got in ((tmp_path / "table.csv", "no such file"), (tmp_path, "a folder")):
        with pytest.raises(SessionError, match=f"got {got}; wanted a table with t_s"):
            CsvTable(path, ["t_s"])


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every file")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("t_s\n")
    path.chmod(0)
    with pytest.raises(SessionError, match="Permission denied"):
        CsvTable(path, ["t_s"])


CELL = st.one_of(st.text(max_size=12), st.floats().map(str), st.sampled_from(["", '"', "\n", ",", "\r", "\0", "nan"]))
ROWS = st.lists(st.lists(CELL, max_size=4).map(",".join), max_size=8).map("\n".join)


@given(st.one_of(st.binary(max_size=200), ROWS.map(lambda t: ("t_s,x_m\n" + t).encode("utf-8", "surrogatepass"))))
def test_arbitrary_bytes_raise_only_project_errors(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    folder = tmp_path_factory.getbasetemp()
    with only(SessionError):
        opened = table(folder, content)
        before: float | None = None
        for row in opened:
            before = opened.advance(row, "t_s", before)
            opened.optional_number(row, "x_m")


def test_utf_16_is_named(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes("t_s,x_m\n1,2\n".encode("utf-16"))
    with pytest.raises(SessionError, match="got text in UTF-16; wanted a table in UTF-8"):
        CsvTable(path, ["t_s"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"t_s;a;b\n0,5;1;2\n", "t.csv: line 1: got cells separated by semicolons; wanted commas between them, and"),
        (b"t_s\ta\tb\n0.5\t1\t2\n", "t.csv: line 1: got cells separated by tabs; wanted commas between them"),
        (
            b"PK\x03\x04\x14\x00\x06\x00xl/workbook.xml",
            "t.csv: got a workbook or another ZIP file; wanted a table saved",
        ),
        # a name may have a semicolon
        (b"x;y\n1\n", "t.csv: line 1: got x;y; wanted a column t_s"),
    ],
)
def test_what_spreadsheets_write_is_named(tmp_path: Path, text: bytes, message: str) -> None:
    (tmp_path / "t.csv").write_bytes(text)
    with pytest.raises(SessionError) as refused:
        CsvTable(tmp_path / "t.csv", ["t_s", "a"])
    assert str(refused.value).startswith(message)
