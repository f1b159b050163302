"""report.html: one self-contained page on one run; its figures are also written as files."""

import gc
import json
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

from groundstation.errors import InputError
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figure_style import RenderedFigure, ReportFigure
from groundstation.evaluation.figures import pictures
from groundstation.evaluation.plain_summary import plain_summary
from groundstation.evaluation.report_tables import accuracy_section, calibration_section, latency_section
from groundstation.files.html_page import (
    PAGE_END,
    Column,
    figure_parts,
    page_head,
    page_header,
    page_table,
    plain,
    verdict_line,
)
from groundstation.files.output_names import below
from groundstation.files.whole_file import whole_file, write_whole

FIGURES = "figures"
# sweeping takes a tenth of a second, which a short flight is not worth
_MANY_EPOCHS = 10_000
_REFERENCES = {"truth": "the truth", "dgps": "DGPS"}
_CLOCK_CAVEAT = (
    "The ± is of what is new at each pair: an error along the path that lasts, as where on the aircraft its nose is "
    "detected, is not in it, and the clock can be several times as far off."
)


def write_report(path: Path, evaluation: Evaluation, config: EvaluationConfig) -> tuple[Path, ...]:
    """Write report.html, and its figures as PNG and SVG into the folder ``figures``; returns page and folder.

    Raises `InputError` if a file can't be written. A run without pictures leaves no folder.
    """
    shown = pictures(evaluation, config.range_bins_m)
    folder = path.parent / FIGURES
    try:
        if shown:
            folder.mkdir(exist_ok=True)
        with whole_file(path) as draft, draft.open("w", encoding="utf-8") as page:
            # a figure is drawn when its turn comes and then let go: of an hour's flight all of them are large
            page.writelines(_page(evaluation, _in_turn(shown, folder, long=len(evaluation.epochs) > _MANY_EPOCHS)))
    except OSError as fault:
        raise InputError(str(path), got=fault.strerror or str(fault), wanted="a file that can be written") from fault
    return (path, folder) if shown else (path,)


def report_page(evaluation: Evaluation, config: EvaluationConfig) -> str:
    """Return the whole page; it loads nothing from anywhere."""
    return "".join(_page(evaluation, (picture.drawn() for picture in pictures(evaluation, config.range_bins_m))))


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
    write_whole(below(folder, f"{name}.svg"), f"<?xml version='1.0' encoding='utf-8'?>\n{drawn.svg}")
    write_whole(below(folder, f"{name}.png"), drawn.png)
    return drawn


def _page(evaluation: Evaluation, shown: Iterable[RenderedFigure]) -> Iterator[str]:
    """Return the page piece by piece."""
    summary = evaluation.summary
    name = str(summary["session"]["name"])
    yield page_head(f"{name} – Groundstation")
    yield "\n".join(
        [
            page_header("replay report", name),
            "<main>",
            verdict_line(plain_summary(summary)),
            *(f"<p class='fault'>{escape(fault)}</p>" for fault in summary["faults"]),
            _tiles(summary),
            *(accuracy_section(name, table) for name, table in summary["accuracy"].items()),
            "",
        ]
    )
    yield from _gallery(shown)
    yield "\n".join(
        [
            "",
            _reference(summary["reference"]),
            calibration_section(summary["calibration"]),
            _counts(summary),
            latency_section(summary),
            _events(evaluation.events),
            _appendix(summary),
            "</main>",
        ]
    )
    yield PAGE_END


def _tiles(summary: dict[str, Any]) -> str:
    """Return the key figures."""
    session, latency, nis = summary["session"], summary["latency_ms"], summary["nis"]["all"]
    tiles = []
    if session["epochs"]:
        tiles.append((f"{session['epochs']} pairs", f"{session['to_s'] - session['from_s']:.1f} s of recording"))
    for name, table in summary["accuracy"].items():
        if table["anees"]:
            a = table["anees"]
            tiles.append(
                (
                    f"ANEES {a['mean']:.2f}",
                    f"against {_REFERENCES.get(name, name)}; 1 is ideal, "
                    f"{a['low_95']:.2f}–{a['high_95']:.2f} if independent",
                )
            )
    if nis["mean"] is not None:
        tiles.append((f"NIS {nis['mean']:.2f}", f"{nis['rejected']} of {nis['judged']} pixels rejected"))
    offset = summary["reference"]["time_offset"]
    if offset and offset["offset_s"] is not None:
        tiles.append((f"{offset['offset_s']:+.4f} s", f"DGPS clock ± {1e3 * offset['sigma_s']:.1f} ms of noise"))
    if latency["p50"]:
        tiles.append((f"{latency['p50']:.1f} ms", f"median latency, {latency['p99']:.1f} ms at 99 %"))
    tiles += [(f"{value:.3g}", key.replace("_", " ")) for key, value in summary["speed"].items() if value is not None]
    cells = "".join(f"<div class='tile'><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in tiles)
    return f"<div class='tiles'>{cells}</div>"


def _gallery(shown: Iterable[RenderedFigure]) -> Iterator[str]:
    """Return the pictures with their captions, one after the other."""
    start = "<h2>Pictures</h2><div class='pictures'>"
    for drawn in shown:
        yield start
        yield from figure_parts(drawn.picture.title, drawn.picture.caption, drawn.svg)
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


def _provenance(table: dict[str, Any]) -> str:
    """Return a table of where the run's data come from; nothing if that is not known."""
    rows = []
    for name, value in table.items():
        parts = value if isinstance(value, dict) else {"": value}
        for part, text in parts.items():
            label = f"{name} {part}".strip().replace("_", " ")
            rows.append(("", [plain(label), plain("–" if text is None else str(text))]))
    return page_table((Column("run"), Column("", text=True)), rows, stacked=False) if rows else ""


def _appendix(summary: dict[str, Any]) -> str:
    """Return provenance, configuration and versions."""
    configuration = escape(json.dumps(summary["configuration"], indent=1, ensure_ascii=False))
    rows = [("", [plain(k), plain(v)]) for k, v in summary["versions"].items()]
    versions = page_table((Column("part"), Column("version", text=True)), rows, stacked=False)
    return (
        f"<h2>Provenance, configuration and versions</h2>{_provenance(summary['provenance'])}"
        f"<details><summary>Resolved configuration</summary><pre class=long>{configuration}</pre></details>"
        "<details open><summary>Versions</summary>"
        f"{versions}</details>"
    )
