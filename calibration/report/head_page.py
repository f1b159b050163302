"""report.html of a calibration of heads: the verdict, then each station with its pictures, then the report in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from calibration.report.picture import ReportPicture, shown, write_page
from groundstation.files.html_page import bullet_list, html_page, page_header, preformatted, text_table, verdict_line


@dataclass(frozen=True, slots=True, kw_only=True)
class PagePart:
    """One part of the page: its heading, the lines of a verdict, a list, a table (head first), pictures, and text."""

    heading: str
    verdict: Sequence[str] = ()
    items: Sequence[str] = ()
    table: Sequence[Sequence[str]] = ()
    pictures: Sequence[ReportPicture] = ()
    text: str = ""


def station_heading(name: str) -> str:
    """Return the heading of a station's part."""
    return f"Station {name}"


def write_head_page(
    folder: Path, kind: str, title: str, parts: Sequence[PagePart], verdict: Sequence[str] = ()
) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files.

    ``kind`` says what the report is of; a verdict's first line stands out.
    """
    body = [page_header(kind, title), _verdict(verdict), *(_part(part) for part in parts)]
    text = html_page(f"{title} – {kind}", "\n".join(piece for piece in body if piece))
    return write_page(folder, text, [picture for part in parts for picture in part.pictures])


def _part(part: PagePart) -> str:
    pieces = [f"<h2>{escape(part.heading)}</h2>", _verdict(part.verdict)]
    pieces += [bullet_list(part.items)] if part.items else []
    pieces += [text_table(part.table[0], part.table[1:])] if part.table else []
    pieces += [shown(part.pictures)] if part.pictures else []
    pieces += [preformatted(part.text)] if part.text else []
    return "\n".join(piece for piece in pieces if piece)


def _verdict(lines: Sequence[str]) -> str:
    if not lines:
        return ""
    return verdict_line(lines[0]) + (bullet_list(lines[1:]) if lines[1:] else "")
