"""comparison.html: one self-contained page on several runs: verdict, notes, tables, and pictures of all runs."""

import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from groundstation.errors import printable
from groundstation.evaluation.comparison_tables import WIDE_COLUMNS, RunsTable
from groundstation.evaluation.comparison_text import REFERENCE_WORDS, ScoredRun
from groundstation.evaluation.figure_style import RenderedFigure, ReportFigure
from groundstation.evaluation.key_figures import AXES
from groundstation.files.html_page import (
    PAGE_END,
    Column,
    bullet_list,
    figure_parts,
    page_head,
    page_header,
    plain,
    soft_line,
    text_table,
    verdict_line,
)
from groundstation.files.output_names import below
from groundstation.files.whole_file import write_bytes_whole, write_text_whole

_MOST_NAMES = 4
# shares of pairs with an estimate, %, that differ by no more are alike
_EVEN_PERCENT = 1.0
# in the dark the figures stay light: their colours are chosen against white
_STYLE = """
:root{color-scheme:light dark}
@media screen and (prefers-color-scheme:dark){
:root{--ink:#e4e8ec;--soft:#a5afb9;--line:#3a434d;--panel:#20272e;--accent:#56B4E9}
body{background:#14181c}figure svg{background:#fff;border-radius:6px}}
"""


def write_comparison_page(
    path: Path,
    plots: Path,
    title: str,
    verdict: str,
    notes: Sequence[str],
    tables: Iterable[RunsTable],
    pictures: Sequence[ReportFigure],
) -> list[Path]:
    """Write the page, and its pictures as SVG and PNG into the folder ``plots``; returns the paths written.

    Raises `InputError` if one can't be written. Without pictures there is no folder.
    """
    drawn = (_kept(picture, plots) for picture in pictures)
    write_text_whole(path, "".join(_page(title, verdict, notes, tables, drawn)))
    return [path, plots] if pictures else [path]


def comparison_verdict(runs: Sequence[ScoredRun], baseline: ScoredRun, reference: str | None, *, same: bool) -> str:
    """Return what the comparison found, in a sentence or two.

    ``reference`` is the one to compare with, ``same`` whether the runs have the same pairs.
    """
    if reference is None:
        tracked = [run.name for run in runs if run.figures.get("pairs.tracking")]
        return (
            "No run has errors: a reference (truth.csv, or a DGPS log) or a track is missing. "
            f"Tracked: {', '.join(tracked) if tracked else 'none'}."
        )
    words = printable(REFERENCE_WORDS.get(reference, reference))
    sizes = {run.name: size for run in runs if (size := _distance(run, reference)) is not None}
    best = min(sizes, key=lambda name: sizes[name])
    if len(sizes) == 1:
        return f"{best}: RMSE {sizes[best]:.3f} m in 3-D against {words}.{_honesty(runs, best, reference)}"
    if len({f"{size:.3f}" for size in sizes.values()}) == 1:
        alike = f"{', '.join(list(sizes)[:_MOST_NAMES])} have the same error in 3-D against {words}, RMSE"
        return f"{alike} {sizes[best]:.3f} m.{_honesty(runs, best, reference)}"
    seen = {run.name: 100.0 * run.figures.get(f"{reference}.all.ekf.coverage", 0.0) for run in runs}
    # a run that has no estimate where it is difficult has small errors
    uneven = max(seen[name] for name in sizes) - min(seen[name] for name in sizes) > _EVEN_PERCENT
    found = {
        name: f"{size:.3f} m" + (f" in {seen[name]:.0f} % of its pairs" if uneven else "")
        for name, size in sorted(sizes.items(), key=lambda item: item[1])
    }
    others = ", ".join(f"{name} {of}" for name, of in list(found.items())[1:_MOST_NAMES])
    rest = f" and {len(sizes) - _MOST_NAMES} more" if len(sizes) > _MOST_NAMES else ""
    pairs = "" if same and not uneven else ", though not of the same pairs"
    return (
        f"Smallest error in 3-D against {words}{pairs}: {best}, RMSE {found[best]} ({others}{rest}; differences "
        f"in the tables are to {baseline.name}).{_honesty(runs, best, reference)}"
    )


def _honesty(runs: Sequence[ScoredRun], name: str, reference: str) -> str:
    """Return in words whether the errors of a run are as large as it states."""
    anees = next(run.figures.get(f"{reference}.all.ekf.anees") for run in runs if run.name == name)
    if anees is None:
        return ""
    than = "about as large as" if 0.5 <= anees <= 2.0 else "smaller than" if anees < 0.5 else "larger than"
    return f" Its errors are {than} its covariance states (ANEES {anees:.2f}; 1 is ideal)."


def _distance(run: ScoredRun, reference: str) -> float | None:
    """Return a run's RMSE in 3-D, of its three axes."""
    axes = [run.figures.get(f"{reference}.all.ekf.rmse_{axis}_m") for axis in AXES]
    known = [value for value in axes if value is not None]
    return sum(value**2 for value in known) ** 0.5 if len(known) == len(axes) else None


def compared_reference(runs: Sequence[ScoredRun]) -> str | None:
    """Return the reference with the most runs that have errors against it, the truth first; None without one."""
    counts = {name: sum(_distance(run, name) is not None for run in runs) for name in REFERENCE_WORDS}
    best = max(counts, key=lambda name: counts[name])
    return best if counts[best] else None


def _kept(picture: ReportFigure, folder: Path) -> RenderedFigure:
    """Draw a picture, write its two files and hand it on."""
    with warnings.catch_warnings():
        # a run's name may have letters that the font of the PNG lacks; the SVG shows them
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        drawn = picture.drawn()
    write_text_whole(below(folder, f"{picture.name}.svg"), f"<?xml version='1.0' encoding='utf-8'?>\n{drawn.svg}")
    write_bytes_whole(below(folder, f"{picture.name}.png"), drawn.png)
    return drawn


def _page(
    title: str, verdict: str, notes: Sequence[str], tables: Iterable[RunsTable], drawn: Iterable[RenderedFigure]
) -> Iterator[str]:
    """Yield the page piece by piece."""
    yield page_head(f"{title} – Groundstation", _STYLE)
    yield f"{page_header('comparison of runs', title)}<main>{verdict_line(verdict)}"
    if notes:
        yield f"<h2>Notes</h2>{bullet_list(notes)}"
    start = "<h2>Pictures</h2><div class='pictures'>"
    for figure in drawn:
        yield start
        yield from figure_parts(figure.picture.title, figure.picture.caption, figure.svg)
        start = ""
    if not start:
        yield "</div>"
    for table in tables:
        columns = [Column(name, text=number > 0 and name in WIDE_COLUMNS) for number, name in enumerate(table.columns)]
        yield f"<h2>{plain(table.title)}</h2>{text_table(columns, table.rows)}"
        if table.remark:
            yield soft_line(table.remark)
    yield f"</main>{PAGE_END}"
