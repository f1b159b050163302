"""The start of the report: its verdict and the few figures behind it, each with what it means."""

from html import escape
from typing import Any

from groundstation.evaluation.chi_square_words import describe_nees, describe_nis
from groundstation.evaluation.plain_summary import plain_remarks, plain_summary
from groundstation.files.html_page import soft_line, verdict_line

_REFERENCES = {"truth": "the exact positions", "dgps": "DGPS"}


def verdict_section(summary: dict[str, Any]) -> str:
    """Return the verdict, what of the inputs cannot be right or was not usable, and the key figures."""
    remarks = plain_remarks(summary)
    return "\n".join(
        [
            verdict_line(plain_summary(summary)),
            *(f"<p class='fault'>{escape(fault)}</p>" for fault in summary["faults"]),
            _tiles(summary),
            *([soft_line(remarks)] if remarks else []),
        ]
    )


def _tiles(summary: dict[str, Any]) -> str:
    """Return the key figures: coverage, errors, consistency."""
    tiles = [*_coverage(summary)]
    explained = False
    for name, table in summary["accuracy"].items():
        words = _REFERENCES.get(name, name)
        if table["total"]["ekf"]["rmse_m"]:
            x, y, z = table["total"]["ekf"]["rmse_m"]
            tiles.append((f"{x:.3f} / {y:.3f} / {z:.3f} m", f"error against {words}: root mean square of x / y / z"))
        if table["anees"]:
            figure, meaning = _split(describe_nees(table["anees"], first=not explained))
            tiles.append((figure, f"against {words}{' ' if explained else ': '}{meaning}"))
            explained = True
    nis = summary["nis"]["all"]
    if nis["mean"] is not None:
        tiles.append(_split(describe_nis(nis)))
    cells = "".join(f"<div class='tile'><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in tiles)
    return f"<div class='tiles'>{cells}</div>"


def _split(words: str) -> tuple[str, str]:
    """Return a figure, and what follows on it."""
    name, value, meaning = words.split(" ", 2)
    return f"{name} {value.rstrip(':')}", meaning


def _coverage(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return how much of the run the aircraft was tracked, by two cameras."""
    session, track = summary["session"], summary["counts"]["track"]
    if not session["epochs"]:
        return []
    share = 100 * track["tracking"] / session["epochs"]
    length = session["to_s"] - session["from_s"]
    return [
        (f"{share:.0f} % tracked", f"{track['tracking']} of {session['epochs']} pairs, {length:.1f} s of recording")
    ]
