"""Tables of rows: the same for any order of the workers; and the log of the test set's runs."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.bank.result_table import sorted_rows, table_hash, write_table
from groundstation.bank.run_log import COLUMNS, LoggedRun, append_run, require_log
from groundstation.errors import InputError
from tests.bank.drawn_rows import drawn_row

RUN = LoggedRun(
    date="2026-11-24T10:00:00+00:00", commit="0123456789ab", version="0.1.0", first=0, sessions=400, hit="97.1 %",
    wrong="0.2 %", misleading="0.010 %", rows_sha256="ab",
)  # fmt: skip


@given(st.permutations(range(6)))
def test_the_hash_depends_on_no_order(order: list[int]) -> None:
    rows = [drawn_row(k, hit=10 * k) for k in range(6)]
    assert table_hash([rows[k] for k in order]) == table_hash(rows)
    assert table_hash(rows[1:]) != table_hash(rows)


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Expected: rows by seed, with the columns of all; a missing figure is None."""
    rows = [drawn_row(2), {**drawn_row(1), "baseline_hit_share": 0.5}]
    write_table(tmp_path / "rows.parquet", rows)
    found = pq.read_table(tmp_path / "rows.parquet").to_pylist()
    assert found == sorted_rows(rows)
    assert [row["seed"] for row in found] == [1_000_001, 1_000_002]
    assert [row["baseline_hit_share"] for row in found] == [0.5, None]


def test_each_run_of_the_test_set_is_a_row(tmp_path: Path) -> None:
    log = tmp_path / "runs.csv"
    append_run(log, RUN)
    append_run(log, RUN)
    lines = log.read_text().splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert lines[1:] == ["2026-11-24T10:00:00+00:00,0123456789ab,0.1.0,0,400,97.1 %,0.2 %,0.010 %,ab"] * 2


def test_a_file_that_is_no_log_is_left_alone(tmp_path: Path) -> None:
    other = tmp_path / "notes.csv"
    other.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="columns a, b"):
        append_run(other, RUN)
    assert other.read_text() == "a,b\n1,2\n"
    with pytest.raises(InputError, match="no such folder"):
        require_log(tmp_path / "none" / "runs.csv")
