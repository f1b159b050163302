"""bank.html: one self-contained page on a bank: distributions, factors by harm, the worst sessions with pictures."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from groundstation.bank.bank_figures import bank_figures
from groundstation.bank.bank_settings import BankSettings
from groundstation.bank.dispatcher import JobFailure
from groundstation.bank.factor_figures import PREFIX, ClassFigures, factor_figures
from groundstation.bank.pooled_figures import POOLED, QUANTILES, Distribution, PooledFigure, distributions, pooled
from groundstation.bank.result_table import Row
from groundstation.files.html_page import (
    NOTHING,
    Column,
    bullet_list,
    html_page,
    page_figure,
    page_header,
    picture_grid,
    soft_line,
    text_table,
    verdict_line,
)

_DEFINITIONS = (
    "visible: at least 10 px wide, matched-filter signal-to-noise ratio of 8 or more, at least 20 % of the silhouette "
    "inside the picture and not hidden; from the renderer, before any detector runs. All other frames are excluded.",
    "hit: the reported point is inside the silhouette or within 4 px of it; wrong: any other reported point.",
    "misleading: the status is tracking and an error is beyond 5 sigma, or beyond 3/15/1.5 m (x/y/z) where the stated "
    "covariance gives that a probability below 0.001.",
    "harm: by how many points the share of hits over all frames would rise if the class had that of all others.",
    "baseline: OpenCV's CSRT started by hand on the true box, midpoint triangulation, Kalman filter.",
    "intervals: 95 %, bootstrap over sessions; none where all have the same share: without an event in any they "
    "do not show how rare it is.",
)
_SHARE_COLUMNS = ("sessions", "frames", "hit", "95 %", "wrong", "coverage", "misleading", "excluded", "harm")


@dataclass(frozen=True, slots=True, kw_only=True)
class BankResult:
    """Rows of a bank, a JPEG of each session's worst frames by seed, and the sessions that failed."""

    settings: BankSettings
    rows: Sequence[Row]
    sheets: Mapping[int, bytes]
    failures: Sequence[JobFailure]


def bank_page(result: BankResult, words: str) -> str:
    """Return the page as HTML; ``words`` describe the run: version, date."""
    rows = result.rows
    classes = factor_figures(rows)
    title = f"{result.settings.world_set.value}: {len(rows)} of {result.settings.sessions} worlds"
    body = [
        page_header("bank", title),
        verdict_line(_verdict(rows)),
        soft_line(words),
        _failures(result.failures),
        "<h2>Pooled over all sessions</h2>",
        text_table(["figure", "value", "95 %", "sessions"], [_pooled_cells(pooled(rows, ratio)) for ratio in POOLED]),
        "<h2>Distributions over sessions</h2>",
        picture_grid(_figures(rows, classes)),
        text_table(
            ["figure", *(f"{100 * q:.0f} %" for q in QUANTILES), "sessions"],
            [_distribution_cells(found) for found in distributions(rows)],
        ),
        "<h2>Conditions by harm</h2>",
        text_table(
            [Column("factor", text=True), Column("class", text=True), *_SHARE_COLUMNS],
            [_class_cells(figures) for figures in classes],
        ),
        f"<h2>The worst {min(result.settings.worst, len(rows))} sessions</h2>",
        "".join(_worst(row, result) for row in worst_rows(rows, result.settings.worst)),
        "<h2>Definitions</h2>",
        bullet_list(_DEFINITIONS),
    ]
    return html_page(f"Bank, {title}", "".join(body))


def worst_rows(rows: Sequence[Row], count: int) -> list[Row]:
    """Return the sessions with the lowest share of hits; sessions without a visible frame are not among them."""
    seen = [row for row in rows if row["hit_share"] is not None]
    return sorted(seen, key=lambda row: (row["hit_share"], row["seed"]))[:count]


def share_text(value: float | None) -> str:
    """Return a share in per cent, with more digits where it is small."""
    if value is None:
        return NOTHING
    return f"{100.0 * value:.1f} %" if value == 0.0 or abs(value) >= 0.01 else f"{100.0 * value:.3f} %"


def figure_text(figure: PooledFigure) -> str:
    """Return a pooled figure's value as text."""
    if figure.value is None:
        return NOTHING
    return share_text(figure.value) if figure.ratio.percent else f"{figure.value:.3g}"


def interval_text(low: float | None, high: float | None, percent: bool = True) -> str:
    """Return an interval as text."""
    if low is None or high is None:
        return NOTHING
    return f"{share_text(low)} … {share_text(high)}" if percent else f"{low:.3g} … {high:.3g}"


def _verdict(rows: Sequence[Row]) -> str:
    hit, wrong, coverage, misleading = (figure_text(pooled(rows, ratio)) for ratio in POOLED[:4])
    return (
        f"{hit} of the visible frames hit, {wrong} wrong; coverage {coverage}; "
        f"{misleading} of the tracking epochs are misleading."
    )


def _failures(failures: Sequence[JobFailure]) -> str:
    if not failures:
        return ""
    lines = [f"{failure.name}: {failure.kind.value}: {failure.reason}" for failure in failures]
    return f"<h2>{len(failures)} sessions failed</h2>{bullet_list(lines)}"


def _pooled_cells(figure: PooledFigure) -> list[str]:
    interval = interval_text(figure.low, figure.high, figure.ratio.percent)
    return [figure.ratio.title, figure_text(figure), interval, str(figure.sessions)]


def _distribution_cells(found: Distribution) -> list[str]:
    return [found.title, *(f"{value:.3g}" for value in found.quantiles), str(found.count)]


def _class_cells(figures: ClassFigures) -> list[str]:
    return [
        figures.factor,
        figures.kind,
        str(figures.sessions),
        str(figures.frames),
        share_text(figures.hit),
        interval_text(figures.low, figures.high),
        share_text(figures.wrong),
        share_text(figures.coverage),
        share_text(figures.misleading),
        share_text(figures.excluded),
        f"{100.0 * figures.harm:+.2f}",
    ]


def _figures(rows: Sequence[Row], classes: Sequence[ClassFigures]) -> list[str]:
    drawn = [figure.drawn() for figure in bank_figures(rows, classes)]
    return [page_figure(figure.picture.title, figure.picture.caption, figure.svg) for figure in drawn]


def _worst(row: Row, result: BankResult) -> str:
    """Return one session: its frames, figures, factors and the command that renders it again."""
    seed = int(row["seed"])
    title = f"World {seed}: {share_text(row['hit_share'])} hit, {share_text(row['wrong_share'])} wrong"
    factors = ", ".join(f"{name.removeprefix(PREFIX)} {row[name]}" for name in row if name.startswith(PREFIX))
    settings = result.settings
    command = f"groundstation simulate --world {seed} --duration {settings.duration_s:g} --rate {settings.frame_hz:g}"
    picture = ""
    if result.sheets.get(seed):
        data = base64.b64encode(result.sheets[seed]).decode("ascii")
        picture = f'<img alt="frames of world {seed}" src="data:image/jpeg;base64,{data}">'
    return page_figure(title, f"{factors}. {command} --out DIR", picture)
