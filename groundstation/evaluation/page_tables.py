"""Tables of the pages: rows on a wide screen and on paper, a card for each row on a phone.

A table of more than three columns is stacked where the screen is narrow: its head is hidden and each cell says its
column's name by itself (``data-label``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

MAX_UNSTACKED = 3
NOTHING = "–"
_XYZ = "<span>x</span><span>y</span><span>z</span>"


@dataclass(frozen=True, slots=True, kw_only=False)
class Column:
    """One column: its ``name``, whether its cells hold words (``text``) or x, y and z (``axes``)."""

    name: str
    text: bool = False
    axes: bool = False


def plain(text: str) -> str:
    """Return words as HTML."""
    return escape(str(text))


def axes_cell(values: Sequence[float | None] | None, form: str, unit: str = "") -> str:
    """Return x, y and z below each other's heads; empty where there is nothing."""
    if values is None or all(v is None for v in values):
        return ""
    shown = "".join(f"<span>{NOTHING if v is None else format(v, form) + unit}</span>" for v in values)
    return f"<span class=axes>{shown}</span>"


def page_table(
    columns: Sequence[Column], rows: Sequence[tuple[str, Sequence[str]]], *, stacked: bool | None = None
) -> str:
    """Return a table; each row is its class and its cells, which are HTML.

    ``stacked`` says whether it becomes cards on a phone; by default all do that have more than three columns.
    """
    stack = len(columns) > MAX_UNSTACKED if stacked is None else stacked
    axes = any(c.axes for c in columns)
    head = "".join(f"<th{' class=text' if c.text else ''}>{_head(c)}</th>" for c in columns)
    body = "".join(
        f"<tr{f' class={kind}' if kind else ''}>"
        + "".join(_cell(k, c, cell, stack, axes) for k, (c, cell) in enumerate(zip(columns, cells, strict=True)))
        + "</tr>"
        for kind, cells in rows
    )
    named = any(c.name for c in columns[1:])
    shown_head = f"<thead><tr>{head}</tr></thead>" if named else ""
    return f"<table{' class=stack' if stack else ''}>{shown_head}<tbody>{body}</tbody></table>"


def _head(column: Column) -> str:
    axes = f"<br><span class=axes>{_XYZ}</span>" if column.axes else ""
    return escape(column.name) + axes


def _cell(number: int, column: Column, cell: str, stack: bool, axes: bool) -> str:
    """Return one cell; on a phone it says its column, but for the first, which is the card's title."""
    heads = f"<span class='axes narrow'>{_XYZ}</span>" if stack and axes and not number else ""
    kinds = [name for name, on in (("text", column.text), ("empty", not cell)) if on]
    label = ""
    if stack and number:
        label = f' data-label="{escape(column.name, quote=True)}"'
    kind = f" class='{' '.join(kinds)}'" if kinds else ""
    return f"<td{kind}{label}>{cell or NOTHING}{heads}</td>"
