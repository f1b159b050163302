"""What the reports of all calibrations share: one self-contained page, its style, pictures inside it."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

_CSS = """
:root{--ink:#1b1f24;--soft:#5a636e;--line:#d9dde2;--panel:#f6f8fa;--accent:#0072B2}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1180px;padding:1.2rem 1rem 3rem;font:16px/1.5 system-ui,-apple-system,"Segoe UI",
Roboto,"Helvetica Neue",Arial,sans-serif;color:var(--ink);background:#fff}
h1{font-size:1.6rem;margin:.2rem 0}h2{font-size:1.2rem;margin:2rem 0 .6rem;border-bottom:1px solid var(--line)}
h3{font-size:1rem;margin:1rem 0 .2rem}p,li{max-width:75ch}.soft,figcaption{color:var(--soft);font-size:.88rem}
.verdict{font-size:1.1rem;border-left:4px solid var(--accent);padding:.3rem 0 .3rem .9rem;margin:.8rem 0 1.2rem}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums}
th,td{padding:.25rem .6rem;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}
th:first-child,td:first-child,td.text,th.text{text-align:left}thead th{color:var(--soft);font-weight:600}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,440px),1fr));gap:1.2rem}
figure{margin:0;break-inside:avoid}img{width:100%;height:auto;display:block}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPicture:
    """One picture: file ``name`` without suffix, ``title``, ``caption``, and the PNG file's bytes."""

    name: str
    title: str
    caption: str
    png: bytes


def page(title: str, body: str) -> str:
    """Return a page that loads nothing from anywhere."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_CSS}</style></head><body>\n{body}\n</body></html>\n"
    )


def bullets(lines: Sequence[str]) -> str:
    """Return plain lines as a list."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def figure(picture: ReportPicture) -> str:
    """Return a picture with its title and caption, its data inside."""
    data = base64.b64encode(picture.png).decode("ascii")
    return (
        f"<figure><h3>{escape(picture.title)}</h3>"
        f"<img alt='{escape(picture.title)}' src='data:image/png;base64,{data}'>"
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[int] = ()) -> str:
    """Return a table of plain cells; columns whose places are among ``words`` are aligned as text."""

    def cell(kind: str, k: int, text: str) -> str:
        return f"<{kind}{' class=text' if k in words else ''}>{escape(text)}</{kind}>"

    head = "".join(cell("th", k, text) for k, text in enumerate(heads))
    body = "".join("<tr>" + "".join(cell("td", k, text) for k, text in enumerate(row)) + "</tr>" for row in rows)
    return f"<div class='wide'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def write_page(folder: Path, text: str, pictures: Sequence[ReportPicture]) -> list[Path]:
    """Write report.html and the pictures as PNG into ``folder``, made if missing; returns what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "report.html"]
    written[0].write_text(text, encoding="utf-8")
    for picture in pictures:
        written.append(folder / f"{picture.name}.png")
        written[-1].write_bytes(picture.png)
    return written
