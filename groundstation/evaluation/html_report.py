"""report.html: one self-contained page on one run; its figures are also written as files.

Verdict first, then what can be seen, then tables; effort (times, memory, provenance) last.
"""

import gc
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

from groundstation.errors import InputError, os_words
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.consistency_figures import LATENCY
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figure_style import REPORT_CSS, RenderedFigure, ReportFigure
from groundstation.evaluation.figures import pictures
from groundstation.evaluation.report_effort import effort_section, provenance_section
from groundstation.evaluation.report_tables import accuracy_section, calibration_section
from groundstation.evaluation.report_verdict import verdict_section
from groundstation.evaluation.silhouette_section import SILHOUETTE_CSS, silhouette_section
from groundstation.evaluation.silhouettes import Silhouette
from groundstation.evaluation.zoom_plot import ZOOM_CSS, zoom_plots, zoom_script, zoomable
from groundstation.files.html_page import (
    PAGE_END,
    Column,
    figure_parts,
    page_head,
    page_header,
    page_table,
    plain,
)
from groundstation.files.output_names import below
from groundstation.files.whole_file import whole_file, write_whole

FIGURES = "figures"
# sweeping takes a tenth of a second, which a short flight is not worth
_MANY_EPOCHS = 10_000
_CLOCK_CAVEAT = (
    "The ± is of what is new at each pair: an error along the path that lasts, as where on the aircraft its nose is "
    "detected, is not in it, and the clock can be several times as far off."
)


def write_report(
    path: Path,
    evaluation: Evaluation,
    config: EvaluationConfig,
    silhouettes: Sequence[Sequence[Silhouette]] = (),
    *,
    landings: str = "",
) -> tuple[Path, ...]:
    """Write report.html, and its figures as PNG and SVG into the folder ``figures``; returns page and folder.

    ``silhouettes`` are pairs of pictures from far to near (`SilhouetteCollector.shown`), ``landings`` a section of its
    own, HTML. A run without figures leaves
    no folder. Raises `InputError` if a file can't be written.
    """
    shown = pictures(evaluation, config.range_bins_m)
    folder = path.parent / FIGURES
    try:
        if shown:
            folder.mkdir(exist_ok=True)
        with whole_file(path) as draft, draft.open("w", encoding="utf-8") as page:
            # a figure is drawn when its turn comes and then let go: of an hour's flight all of them are large
            drawn = _in_turn(shown, folder, long=len(evaluation.epochs) > _MANY_EPOCHS)
            page.writelines(_page(evaluation, drawn, silhouettes, landings))
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault
    return (path, folder) if shown else (path,)


def report_page(
    evaluation: Evaluation, config: EvaluationConfig, silhouettes: Sequence[Sequence[Silhouette]] = ()
) -> str:
    """Return the whole page; it loads nothing from anywhere."""
    drawn = (picture.drawn() for picture in pictures(evaluation, config.range_bins_m))
    return "".join(_page(evaluation, drawn, silhouettes, ""))


def _in_turn(shown: Sequence[ReportFigure], folder: Path, *, long: bool) -> Iterator[RenderedFigure]:
    """Draw each figure when it is asked for; of a ``long`` flight, sweep up after each."""
    for picture in shown:
        yield _kept(picture.drawn(), folder)
        if long:
            # figures contain reference cycles of 5 to 10 MB each, freed only by the garbage collector
            gc.collect()


def _kept(drawn: RenderedFigure, folder: Path) -> RenderedFigure:
    """Write a figure's two files and hand it on."""
    name = drawn.picture.name
    write_whole(below(folder, f"{name}.svg"), drawn.svg_file)
    write_whole(below(folder, f"{name}.png"), drawn.png)
    return drawn


def _page(
    evaluation: Evaluation,
    shown: Iterator[RenderedFigure],
    silhouettes: Sequence[Sequence[Silhouette]],
    landings: str,
) -> Iterator[str]:
    """Return the page piece by piece; of the figures ``shown`` that of the latency is the last."""
    summary = evaluation.summary
    name = str(summary["session"]["name"])
    yield page_head(f"{name} – Groundstation", REPORT_CSS + SILHOUETTE_CSS + ZOOM_CSS)
    tracked = summary["counts"]["track"]["tracking"] > 0
    yield "\n".join([page_header("replay report", name), "<main>", verdict_section(summary), ""])
    yield silhouette_section(silhouettes, tracked=tracked)
    latency: list[RenderedFigure] = []
    plots = zoom_plots(evaluation)
    yield from _gallery("<h2>Track, errors and consistency</h2>", _before_latency(shown, latency), plots)
    yield "\n".join(
        [
            "",
            landings,
            *(accuracy_section(reference, table) for reference, table in summary["accuracy"].items()),
            _reference(summary["reference"]),
            calibration_section(summary["calibration"]),
            _counts(summary),
            _events(evaluation.events),
            effort_section(summary),
        ]
    )
    yield from _gallery("", latency, {})
    yield "\n".join(["", provenance_section(summary), "</main>", zoom_script() if plots else ""])
    yield PAGE_END


def _before_latency(shown: Iterator[RenderedFigure], latency: list[RenderedFigure]) -> Iterator[RenderedFigure]:
    """Yield the figures but that of the latency, which goes into the list."""
    for drawn in shown:
        if drawn.picture.name == LATENCY:
            latency.append(drawn)
        else:
            yield drawn


def _gallery(heading: str, shown: Iterable[RenderedFigure], plots: dict[str, str]) -> Iterator[str]:
    """Return the pictures with their captions, one after the other; ``plots`` are those that can be zoomed."""
    start = f"{heading}<div class='pictures'>"
    for drawn in shown:
        yield start
        drawing = zoomable(drawn.svg, plots.get(drawn.picture.name))
        yield from figure_parts(drawn.picture.title, drawn.picture.caption, drawing)
        start = ""
    if not start:
        yield "</div>"


def _reference(reference: dict[str, Any]) -> str:
    """Return what was found about the DGPS log."""
    if not reference["fixes"]:
        return ""
    offset, one = reference["time_offset"], reference["session_clock_is_dgps_clock"]
    if offset is None:
        text = "<p>The log could not be used.</p>"
    elif offset["offset_s"] is None:
        rest = "" if one else " Nothing is compared with it."
        text = f"<p>No clock offset was found: {escape(offset['reason'])}.{rest}</p>"
    else:
        text = (
            f"<p>Clock: t<sub>dgps</sub> = t<sub>session</sub> {offset['offset_s']:+.4f} s ± "
            f"{1e3 * offset['sigma_s']:.1f} ms (1 σ), aligned on the {escape(offset['from'])} at {offset['epochs']} "
            f"pairs, with a constant bias estimated jointly. {_CLOCK_CAVEAT}</p>"
            + ("<p>By the session's word the two clocks are one, so it is not applied.</p>" if one else "")
        )
    spans = "<p>Nothing of the log was left out.</p>"
    if reference["excluded"]:
        columns = (Column("session time"), Column("left out as", text=True), Column("because", text=True))
        rows = [
            ("", [plain(f"{s['from_s']:.2f} – {s['to_s']:.2f} s"), plain(s["reason"]), plain(s["detail"])])
            for s in reference["excluded"]
        ]
        spans = page_table(columns, rows)
    return f"<h2>The DGPS log</h2><p>{reference['fixes']} fixes.</p>{text}{spans}"


def _counts(summary: dict[str, Any]) -> str:
    """Return every status and every reason for a miss, counted."""
    counts = summary["counts"]
    parts = [_bars("Track", counts["track"]), _bars("Triangulation", counts["triangulation"])]
    for name, station in counts["detection"].items():
        reasons = {f"… {k.replace('_', ' ')}": v for k, v in station["miss_reason"].items()}
        parts.append(_bars(f"Camera {name}", {**station["status"], **reasons}))
    return f"<h2>What was found, and why not</h2><div class='columns'>{''.join(parts)}</div>{_channels(summary)}"


def _channels(summary: dict[str, Any]) -> str:
    """Say which channel the level set used, and the contrast on each; the reference system's is saturation."""
    lines = []
    for name, station in summary["channels"].items():
        contrast = ", ".join(f"{channel} {value:.1f}" for channel, value in station["contrast_to_noise"].items())
        used = ", ".join(f"{escape(channel)} in {n}" for channel, n in station["used"].items())
        if contrast:
            lines.append(f"Camera {escape(name)}: {contrast} (level set on {used} detections).")
    if not lines:
        return ""
    return f"<p>Median contrast-to-noise of the silhouettes by channel. {' '.join(lines)}</p>"


def _bars(title: str, counts: dict[str, int]) -> str:
    """Return counts with bars; what never occurred is left out."""
    most = max([*counts.values(), 1])
    rows = [
        ("", [plain(word.replace("_", " ")), str(n), f"<span class=bar style='width:{5 * n / most:.2f}rem'></span>"])
        for word, n in counts.items()
        if n
    ]
    columns = (Column(""), Column("count"), Column("", text=True))
    shown = page_table(columns, rows, stacked=False) if rows else "<p>nothing</p>"
    return f"<div><h3>{escape(title)}</h3>{shown}</div>"


def _events(events: Sequence[tuple[float, str, str]]) -> str:
    """Return the log of the run, folded."""
    if not events:
        return ""
    lines = "\n".join(f"{t:9.3f} s  {level:<8} {text}" for t, level, text in events)
    return f"<h2>Log</h2><details><summary>{len(events)} events</summary><pre>{escape(lines)}</pre></details>"
