"""What the pages of all calibrations have in common: one self-contained file, for a screen, a phone or paper."""

import base64
from collections.abc import Iterable
from html import escape

CSS = """
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


def report_page(title: str, body: str) -> str:
    """Return a page around its body (HTML); it loads nothing from anywhere."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{CSS}</style></head><body>\n{body}\n</body></html>\n"
    )


def report_list(lines: Iterable[str]) -> str:
    """Return lines of text as a list."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def report_figure(title: str, caption: str, png: bytes) -> str:
    """Return a picture with its title and caption, its bytes within."""
    data = base64.b64encode(png).decode("ascii")
    return (
        f"<figure><h3>{escape(title)}</h3>"
        f"<img alt='{escape(title)}' src='data:image/png;base64,{data}'>"
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def report_table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of text cells, the first column to the left."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<div class='wide'><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
