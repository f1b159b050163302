"""Earlier checks of a rig, from its record: how far each station had turned at each, as a picture."""

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from matplotlib.dates import date2num
from matplotlib.figure import Figure

from calibration.landmarks.check_record import RECORD_FORMAT
from calibration.report.drawing import png_of
from calibration.report.picture import ReportPicture

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
# times in a table's own clock start near 0: no dates
_FIRST_DATE_S = 1e9
_MOST_LINES = 10_000
_MOST_BYTES = 50_000_000
_CAPTION = (
    "How far each station had turned since the rig was calibrated, at each check of its record, with one sigma. A"
    " slope is a mount that settles; a step is a knock."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PastCheck:
    """One check: Unix time of its middle, and of each station the turn about pan and tilt with one sigma, degrees."""

    utc_s: float
    turned_deg: dict[str, tuple[float, float]]
    sigma_deg: dict[str, tuple[float, float]]


def read_history(record: Path) -> tuple[PastCheck, ...]:
    """Return the checks of a record that have dates, in order of time; lines that are not understood are left out."""
    if not record.is_file() or record.stat().st_size > _MOST_BYTES:
        return ()
    found = []
    for line in record.read_text(encoding="utf-8", errors="replace").splitlines()[-_MOST_LINES:]:
        one = _past_check(line)
        if one is not None:
            found.append(one)
    return tuple(sorted(found, key=lambda check: check.utc_s))


def _past_check(line: str) -> PastCheck | None:
    try:
        entry = json.loads(line)
        if entry["format"] != RECORD_FORMAT or not entry["stations"]:
            return None
        middle = 0.5 * (float(entry["from_s"]) + float(entry["to_s"]))
        turned, sigma = (
            {name: (float(one[key]["pan"]), float(one[key]["tilt"])) for name, one in entry["stations"].items()}
            for key in ("turned_deg", "sigma_deg")
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    if not np.isfinite(middle) or middle < _FIRST_DATE_S:
        return None
    return PastCheck(utc_s=middle, turned_deg=turned, sigma_deg=sigma)


def history_picture(history: tuple[PastCheck, ...]) -> ReportPicture | None:
    """Draw pan and tilt of each station over the date; None for fewer than two checks."""
    if len(history) < 2:
        return None
    names = list(dict.fromkeys(name for check in history for name in check.turned_deg))
    return ReportPicture(
        name="drift", title="Since the calibration", caption=_CAPTION, png=png_of(_draw, history, names)
    )


def _draw(figure: Figure, history: tuple[PastCheck, ...], names: list[str]) -> None:
    for axis, word in enumerate(("pan", "tilt")):
        plot = figure.add_subplot(2, 1, axis + 1)
        plot.axhline(0.0, color="0.7", lw=1)
        for colour, name in zip(_COLOURS * 11, names, strict=False):
            own = [check for check in history if name in check.turned_deg]
            plot.errorbar(
                date2num([datetime.fromtimestamp(check.utc_s, UTC) for check in own]),
                [check.turned_deg[name][axis] for check in own],
                [check.sigma_deg[name][axis] for check in own],
                fmt="o-",
                ms=5,
                lw=1,
                capsize=3,
                color=colour,
                label=name,
            )
        plot.xaxis_date()
        plot.set_ylabel(f"{word}, deg")
        plot.tick_params(axis="x", rotation=20)
        if axis == 0:
            plot.legend(frameon=False, ncols=3)
