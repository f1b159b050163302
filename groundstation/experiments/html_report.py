"""reproduce.html: all experiments on one self-contained page, this project's figures next to the paper's."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from groundstation.experiments.experiment import Experiment, Findings, PaperFigure
from groundstation.experiments.tables import ResultTable, shown
from groundstation.files.html_page import (
    Column,
    bullet_list,
    html_page,
    page_figure,
    page_header,
    page_table,
    plain,
    png_image,
    soft_line,
)
from groundstation.files.output_names import below

_TIME_MARK = " †"
# more than these are set smaller, so that a screen of 1440 px shows them all
_MANY_COLUMNS = 14
_STYLE = (
    "figure{margin:1rem 0}"
    "nav li{margin:.15rem 0}.wide table{font-size:.84rem}.wide th,.wide td{padding:.2rem .4rem}"
    ".wide td.text{min-width:7rem}.many table{font-size:.74rem}.many th,.many td{padding:.2rem .2rem}"
    ".many th{font-size:.66rem}.many td.text{min-width:5.5rem}"
    "@media print{.wide{overflow:visible}.wide table{font-size:6.5pt}.wide td.text{min-width:0}"
    ".many table{font-size:5.2pt}.many th{font-size:4.8pt}.many th,.many td{padding:.1rem .12rem}"
    "figure{break-inside:avoid}figure img{max-height:120mm}}"
)


def paper_page(title: str, found: Sequence[tuple[Experiment, Findings]], folder: Path, notes: Sequence[str]) -> str:
    """Return the page; its pictures, already drawn into ``folder``, become part of it."""
    parts = [
        page_header("the papers' experiments", title) + "<main>",
        *(f"<p>{escape(note)}</p>" for note in notes),
        f"<p>Columns marked{_TIME_MARK} are processor times: they differ from run to run. All else repeats.</p>",
        "<nav><ol>",
        *(
            f"<li><a href='#{e.name}'>{escape(e.title)}</a> <span class='soft'>{escape(e.numbers)}</span></li>"
            for e, _ in found
        ),
        "</ol></nav>",
        *(_section(experiment, findings, folder) for experiment, findings in found),
        "</main>",
    ]
    return html_page(title, "\n".join(parts), _STYLE)


def _section(experiment: Experiment, findings: Findings, folder: Path) -> str:
    listed = "<h3>Differences in set-up</h3>" + bullet_list(findings.differences) if findings.differences else ""
    return (
        f"<section id='{experiment.name}'><h2>{escape(experiment.title)}</h2>"
        + soft_line(f"{experiment.paper.value}: {experiment.numbers}")
        + "".join(_table(table) for table in findings.tables)
        + "".join(_figure(figure, folder) for figure in findings.figures)
        + f"{listed}</section>"
    )


def _table(table: ResultTable) -> str:
    columns = [
        Column(name + (_TIME_MARK if k in table.timed else ""), text=_is_text(table, k))
        for k, name in enumerate(table.columns)
    ]
    rows = [("", [plain(shown(cell)) if cell not in (None, "") else "" for cell in row]) for row in table.rows]
    notes = "".join(soft_line(note) for note in table.notes)
    kind = "wide many" if len(columns) > _MANY_COLUMNS else "wide"
    return f"<h3>{escape(table.title)}</h3><div class='{kind}'>{page_table(columns, rows)}</div>{notes}"


def _is_text(table: ResultTable, column: int) -> bool:
    return any(isinstance(row[column], str) for row in table.rows)


def _figure(figure: PaperFigure, folder: Path) -> str:
    png = below(folder, f"{figure.name}.png").read_bytes()
    return page_figure(figure.title, figure.caption, png_image(png, f"{figure.title}. {figure.caption}"))
