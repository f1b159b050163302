"""Rows of a bank as a Parquet table: sorted by seed, with a hash that does not depend on how they were made."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from groundstation.bank.result_store import write_atomically

Row = Mapping[str, Any]


def sorted_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return rows by ascending seed, each with the columns of all; what a row lacks is None."""
    columns: dict[str, None] = {}
    for row in rows:
        columns |= dict.fromkeys(row)
    return [{name: row.get(name) for name in columns} for row in sorted(rows, key=lambda row: int(row["seed"]))]


def table_hash(rows: Sequence[Row]) -> str:
    """Return SHA-256 of the sorted rows, columns by name."""
    text = json.dumps(sorted_rows(rows), sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write rows, sorted, as Parquet; a column of whole numbers and fractions is one of fractions."""
    table = pa.Table.from_pylist(sorted_rows(rows))
    write_atomically(path, lambda draft: pq.write_table(table, draft))
