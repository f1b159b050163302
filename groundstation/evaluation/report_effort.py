"""The report's end: what the run took, and where its data come from."""

import json
from html import escape
from typing import Any

from groundstation.files.html_page import Column, page_table, plain

_PERCENTILES = (("p50", "median"), ("p90", "90 %"), ("p99", "99 %"), ("max", "worst"))
_SPEED = {
    "preparation_s": ("preparation", "s"),
    "replay_s": ("replay", "s"),
    "epochs_per_s": ("pairs per second", ""),
    "times_real_time": ("times real time", ""),
}


def effort_section(summary: dict[str, Any]) -> str:
    """Return how long the run, its answers and its detections took."""
    timed = [("pair, from its first picture to its estimate", summary["latency_ms"])]
    timed += [(f"detection, camera {name}", times) for name, times in summary["detection_ms"].items()]
    rows = [
        ("", [plain(name), *(f"{times[key]:.1f}" for key, _ in _PERCENTILES)])
        for name, times in timed
        if times["p50"] is not None
    ]
    columns = (Column("latency in ms"), *(Column(word) for _, word in _PERCENTILES))
    latency = page_table(columns, rows) if rows else ""
    speed = []
    for key, value in summary["speed"].items():
        if value is not None:
            words, unit = _SPEED.get(key, (key.replace("_", " "), ""))
            speed.append(("", [plain(words), plain(f"{value:.3g} {unit}".rstrip())]))
    run = page_table((Column("run"), Column("")), speed, stacked=False) if speed else ""
    return f"<h2>Effort</h2><div class='columns'><div>{latency}</div><div>{run}</div></div>" if latency or run else ""


def provenance_section(summary: dict[str, Any]) -> str:
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


def _provenance(table: dict[str, Any]) -> str:
    """Return a table of where the run's data come from; nothing if that is not known."""
    rows = []
    for name, value in table.items():
        parts = value if isinstance(value, dict) else {"": value}
        for part, text in parts.items():
            label = f"{name} {part}".strip().replace("_", " ")
            rows.append(("", [plain(label), plain("–" if text is None else str(text))]))
    return page_table((Column("run"), Column("", text=True)), rows, stacked=False) if rows else ""
