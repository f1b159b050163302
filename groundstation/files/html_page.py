"""HTML pages of reports: style, escaping, tables, lists and figures; one self-contained file that loads nothing.

Pages are for a screen, a phone or paper. A table of more than three columns is stacked where the screen is narrow: its
head is hidden and each cell carries its column's name (``data-label``).
"""

import base64
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

MAX_UNSTACKED = 3
NOTHING = "–"
_XYZ = "<span>x</span><span>y</span><span>z</span>"
PAGE_CSS = """
:root{--ink:#1b1f24;--soft:#515a64;--line:#d9dde2;--panel:#f6f8fa;--accent:#0072B2}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1320px;padding:1.2rem 1rem 3rem;font:16px/1.5 system-ui,-apple-system,"Segoe UI",
Roboto,"Helvetica Neue",Arial,sans-serif;color:var(--ink);background:#fff;overflow-wrap:break-word}
h1{font-size:1.6rem;margin:.2rem 0}h2{font-size:1.2rem;margin:2rem 0 .6rem;border-bottom:1px solid var(--line)}
h3{font-size:1rem;margin:1rem 0 .2rem}
p{margin:.4rem 0}p,li{max-width:75ch}.soft,figcaption{color:var(--soft);font-size:.88rem}
.verdict{font-size:1.1rem;border-left:4px solid var(--accent);padding:.3rem 0 .3rem .9rem;margin:.8rem 0 1.2rem}
.fault{border-left:4px solid #D55E00;padding:.2rem 0 .2rem .9rem}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:.6rem}
.tile{background:var(--panel);border-radius:6px;padding:.5rem .8rem}.tile b{display:block;font-size:1.15rem}
.tile span{color:var(--soft);font-size:.85rem}
table{border-collapse:collapse;font-size:.9rem;font-variant-numeric:tabular-nums;max-width:100%}
th,td{padding:.22rem .6rem;text-align:right;border-bottom:1px solid var(--line);vertical-align:top}
th:first-child,td:first-child,th.text,td.text{text-align:left}td.text{min-width:11rem}
thead th{color:var(--soft);font-weight:600}.total td{font-weight:600}
.axes{display:inline-grid;grid-template-columns:repeat(3,3.8em);white-space:nowrap}.narrow{display:none}
td:first-child{white-space:nowrap}td.text{white-space:normal;overflow-wrap:anywhere}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,380px),1fr));gap:1.6rem}
figure{margin:0;break-inside:avoid}figure svg,.pictures img{width:100%;height:auto;display:block}
figure img{max-width:100%;height:auto}.wide{overflow-x:auto}
.bar{display:inline-block;height:.7rem;background:var(--accent);vertical-align:middle;border-radius:2px;min-width:1px}
.columns{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,360px),1fr));gap:1.2rem}
pre{background:var(--panel);padding:.7rem;font-size:.82rem;border-radius:6px;white-space:pre-wrap;
overflow-wrap:anywhere}
summary{cursor:pointer;font-weight:600;padding:.5rem 0}
@media screen and (max-width:1340px){.stack{font-size:.75rem}.stack th,.stack td{padding:.22rem .3rem}
.stack .axes{grid-template-columns:repeat(3,3.6em)}}
@media screen and (max-width:1050px){.stack{font-size:.9rem}
.stack,.stack tbody,.stack tr,.stack td{display:block;width:100%}.stack thead{display:none}
.stack tr{padding:.5rem 0;border-bottom:1px solid var(--line)}
.stack td{display:flex;justify-content:space-between;gap:1rem;border:0;padding:.08rem 0;text-align:right}
.stack td:first-child{font-weight:600;white-space:normal}.stack .narrow{display:inline-grid;color:var(--soft);
font-weight:400}.stack td[data-label]::before{content:attr(data-label);color:var(--soft);
text-align:left;font-weight:400}.stack td.empty{display:none}td.text{min-width:0}}
@media print{@page{margin:14mm}html{font-size:12px}body{max-width:none;font-size:10.5pt;padding:0}
.pictures{display:block;columns:2;column-gap:8mm}.pictures figure{margin:0 0 5mm}h2,h3{break-after:avoid}
details::details-content{display:block;content-visibility:visible;block-size:auto}
pre{font-size:6.5pt}.long{columns:3}h2+p{break-after:avoid}tr,.tile,.verdict{break-inside:avoid}
.tile,.bar,pre{-webkit-print-color-adjust:exact;print-color-adjust:exact}table{font-size:6.8pt}
th,td{padding:.15rem .2rem}td.text{min-width:0}
.axes{grid-template-columns:repeat(3,minmax(2.4em,max-content));column-gap:.4em}
h2{margin-top:1.2rem}.columns{grid-template-columns:1fr 1fr}}
"""
PAGE_END = "\n</body></html>\n"


@dataclass(frozen=True, slots=True, kw_only=False)
class Column:
    """One column: its ``name``, whether its cells hold words (``text``) or x, y and z (``axes``)."""

    name: str
    text: bool = False
    axes: bool = False


def page_head(title: str, style: str = "") -> str:
    """Return the start of a page up to its body; ``title`` is text, ``style`` CSS beyond that of all pages."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{PAGE_CSS}{style}</style></head><body>\n"
    )


def html_page(title: str, body: str, style: str = "") -> str:
    """Return a page around its ``body``, which is HTML."""
    return f"{page_head(title, style)}{body}{PAGE_END}"


def page_header(kind: str, title: str) -> str:
    """Return the heading of a report: what kind it is of, and its title."""
    return f"<header><p class='soft'>Groundstation · {escape(kind)}</p><h1>{escape(title)}</h1></header>"


def verdict_line(text: str) -> str:
    """Return a report's result in one sentence."""
    return f"<p class='verdict'>{escape(text)}</p>"


def soft_line(text: str) -> str:
    """Return a remark in small grey letters."""
    return f"<p class='soft'>{escape(text)}</p>"


def bullet_list(lines: Iterable[str]) -> str:
    """Return lines of text as a list."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def preformatted(text: str) -> str:
    """Return text in columns as it stands."""
    return f"<div class='wide'><pre>{escape(text)}</pre></div>"


def png_image(png: bytes, text: str) -> str:
    """Return a picture, its bytes within the page, and the text that stands for it."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{data}">'


def page_figure(title: str, caption: str, drawing: str) -> str:
    """Return a figure of a ``drawing`` in HTML (SVG, or `png_image`) with its title and caption."""
    return "".join(figure_parts(title, caption, drawing))


def figure_parts(title: str, caption: str, drawing: str) -> Iterator[str]:
    """Yield a figure piece by piece, so that a large drawing is not copied."""
    yield f"<figure><h3>{escape(title)}</h3>"
    yield drawing
    yield f"<figcaption>{escape(caption)}</figcaption></figure>"


def png_figure(title: str, caption: str, png: bytes) -> str:
    """Return a figure of a PNG file's bytes."""
    return page_figure(title, caption, png_image(png, title))


def picture_grid(figures: Iterable[str]) -> str:
    """Return figures side by side, as many as fit."""
    return f"<div class='pictures'>{''.join(figures)}</div>"


def text_table(columns: Sequence[Column | str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of text cells; the first column is to the left."""
    named = [column if isinstance(column, Column) else Column(column) for column in columns]
    return f"<div class='wide'>{page_table(named, [('', [plain(cell) for cell in row]) for row in rows])}</div>"


def plain(text: str) -> str:
    """Return text as HTML."""
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

    ``stacked`` selects cards on a phone; by default tables with more than three columns are stacked.
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
    """Return one cell; on a phone it shows its column's name, except for the first, which is the card's title."""
    heads = f"<span class='axes narrow'>{_XYZ}</span>" if stack and axes and not number else ""
    kinds = [name for name, on in (("text", column.text), ("empty", not cell)) if on]
    label = ""
    if stack and number:
        label = f' data-label="{escape(column.name, quote=True)}"'
    kind = f" class='{' '.join(kinds)}'" if kinds else ""
    return f"<td{kind}{label}>{cell or NOTHING}{heads}</td>"
