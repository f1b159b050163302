"""Tables of an experiment: printed and written as Markdown, written as CSV."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from groundstation.files.output_names import below

Cell = str | float | int | None


@dataclass(frozen=True, kw_only=True)
class ResultTable:
    """One table.

    Attributes
    ----------
    name : its file's.
    columns, rows : None is an empty cell.
    notes : the paragraphs below it.
    timed : the numbers, from 0, of the columns that hold times: they differ from run to run.
    """

    name: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    notes: Sequence[str] = ()
    timed: Sequence[int] = ()

    def markdown(self) -> str:
        """Return the title, the table and its notes."""
        lines = [f"## {self.title}", "", _line(self.columns), "|" + "---|" * len(self.columns)]
        lines += [_line([shown(cell) for cell in row]) for row in self.rows]
        for note in self.notes:
            lines += ["", note]
        return "\n".join(lines) + "\n"

    def write_csv(self, folder: Path) -> None:
        """Write the table in full precision."""
        with below(folder, f"{self.name}.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(self.columns)
            writer.writerows(["" if cell is None else cell for cell in row] for row in self.rows)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def shown(cell: Cell) -> str:
    """Return a cell as it is printed."""
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.3g}" if abs(cell) < 10 else f"{cell:.1f}"
    return str(cell)
