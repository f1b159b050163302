"""report.html: one self-contained page on one run, for a screen, a phone or paper."""

import json
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from groundstation.errors import InputError
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figures import Picture, pictures
from groundstation.evaluation.table import FEW_EPOCHS
from groundstation.evaluation.verdict import verdict

_REFERENCES = {"truth": "Against the truth", "dgps": "Against DGPS"}

_CSS = """
:root{--ink:#1b1f24;--soft:#5a636e;--line:#d9dde2;--panel:#f6f8fa;--accent:#0072B2}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1180px;padding:1.2rem 1rem 3rem;font:16px/1.5 system-ui,-apple-system,"Segoe UI",
Roboto,"Helvetica Neue",Arial,sans-serif;color:var(--ink);background:#fff}
h1{font-size:1.6rem;margin:.2rem 0}h2{font-size:1.2rem;margin:2rem 0 .6rem;border-bottom:1px solid var(--line)}
h3{font-size:1rem;margin:1rem 0 .2rem}
p{margin:.4rem 0;max-width:75ch}.soft,figcaption{color:var(--soft);font-size:.86rem}
.verdict{font-size:1.1rem;border-left:4px solid var(--accent);padding:.3rem 0 .3rem .9rem;margin:.8rem 0 1.2rem}
.fault{border-left:4px solid #D55E00;padding:.2rem 0 .2rem .9rem}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:.6rem}
.tile{background:var(--panel);border-radius:6px;padding:.5rem .8rem}.tile b{display:block;font-size:1.15rem}
.tile span{color:var(--soft);font-size:.82rem}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums}
th,td{padding:.22rem .5rem;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}
th:first-child,td:first-child{text-align:left;position:sticky;left:0;background:#fff}
thead th{color:var(--soft);font-weight:600}.total td{font-weight:600}.first{border-left:2px solid var(--line)}
th.text,td.text{text-align:left}td.text{text-align:left;white-space:normal;min-width:16rem}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,480px),1fr));gap:1.2rem}
figure{margin:0;break-inside:avoid}figure svg{width:100%;height:auto;display:block}
.bar{display:inline-block;height:.7rem;background:var(--accent);vertical-align:middle;border-radius:2px;min-width:1px}
.columns{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,420px),1fr));gap:1.2rem}
pre{background:var(--panel);padding:.7rem;overflow-x:auto;font-size:.8rem;border-radius:6px}
summary{cursor:pointer;font-weight:600;margin:.5rem 0}
@media print{body{max-width:none;font-size:11pt;padding:0}.pictures{grid-template-columns:1fr 1fr}h2{break-after:avoid}
.wide{overflow:visible}table{font-size:8.5pt}}
"""


def write_report(path: Path, evaluation: Evaluation, config: EvaluationConfig) -> None:
    """Write report.html; raises `InputError` if the file can't be written."""
    try:
        path.write_text(report_page(evaluation, config), encoding="utf-8")
    except OSError as fault:
        raise InputError(str(path), got=str(fault), wanted="a file that can be written") from fault


def report_page(evaluation: Evaluation, config: EvaluationConfig) -> str:
    """Return the whole page; it loads nothing from anywhere."""
    summary = evaluation.summary
    name = escape(str(summary["session"]["name"]))
    body = "\n".join(
        [
            f"<header><p class='soft'>Groundstation · replay report</p><h1>{name}</h1></header>",
            f"<p class='verdict'>{escape(verdict(summary))}</p>",
            *(f"<p class='fault'>{escape(fault)}</p>" for fault in summary["faults"]),
            _tiles(summary),
            *(_accuracy(name, table) for name, table in summary["accuracy"].items()),
            _gallery(pictures(evaluation, config.range_bins_m)),
            _reference(summary["reference"]),
            _counts(summary),
            _events(evaluation.events),
            _appendix(summary),
        ]
    )
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{name} – Groundstation</title><style>{_CSS}</style></head><body>\n{body}\n</body></html>\n"
    )


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
                    f"against {name}; 1 is ideal, {a['low_95']:.2f}–{a['high_95']:.2f} if independent",
                )
            )
    if nis["mean"] is not None:
        tiles.append((f"NIS {nis['mean']:.2f}", f"{nis['rejected']} of {nis['judged']} pixels rejected"))
    offset = summary["reference"]["time_offset"]
    if offset and offset["offset_s"] is not None:
        tiles.append((f"{offset['offset_s']:+.4f} s", f"DGPS clock ± {1e3 * offset['sigma_s']:.1f} ms"))
    if latency["p50"]:
        tiles.append((f"{latency['p50']:.1f} ms", f"median latency, {latency['p99']:.1f} ms at 99 %"))
    tiles += [(f"{value:.3g}", key.replace("_", " ")) for key, value in summary["speed"].items() if value is not None]
    cells = "".join(f"<div class='tile'><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in tiles)
    return f"<div class='tiles'>{cells}</div>"


def _accuracy(name: str, table: dict[str, Any]) -> str:
    """Return one reference's accuracy table."""
    head = (
        "<thead><tr><th></th><th>pairs</th><th colspan=3 class=first>EKF, RMSE in m</th><th colspan=3 class=first>"
        "triangulation, RMSE in m</th><th colspan=3 class=first>EKF better by</th>"
        "<th colspan=3 class=first>EKF / bound</th></tr><tr><th></th><th></th>"
        + "<th class=first>x</th><th>y</th><th>z</th>" * 4
        + "</tr></thead>"
    )
    rows = [_accuracy_row("all", table["total"], "total")]
    for group in table["by_range"]:
        upper = f" – {group['to_m']:.0f}" if group["to_m"] is not None else " and more"
        rows.append(_accuracy_row(f"y {group['from_m']:.0f}{upper} m", group))
    rows += [_accuracy_row(f"{k} behind", g) for k, g in table["by_phase"].items() if g["reference_epochs"]]
    ekf, points = table["total"]["ekf"], table["total"]["triangulation"]
    note = (
        "EKF and triangulation on the same pairs. With a reference at "
        f"{table['total']['reference_epochs']} pairs, the EKF has an estimate at {100 * ekf['coverage']:.1f} % of "
        f"them, triangulation at {100 * points['coverage']:.1f} %."
    )
    if ekf["rmse_m"]:
        note += (
            f" EKF on all of its pairs: RMSE {_triple(ekf['rmse_m'])} m, mean {_triple(ekf['mean_m'])} m, 95 % within "
            f"{_triple(ekf['p95_m'])} m, worst {_triple(ekf['max_m'])} m (x / y / z)."
        )
    return (
        f"<h2>{_REFERENCES.get(name, escape(name))}</h2><div class='wide'><table>{head}<tbody>{''.join(rows)}"
        f"</tbody></table></div><p class='soft'>{note}</p>"
    )


def _accuracy_row(name: str, group: dict[str, Any], kind: str = "") -> str:
    """Return one row of the accuracy table."""
    common = group["common"]
    ratio = group["bound"]["ekf_over_track"]
    cells = [f"<td>{escape(name)}</td><td>{common['epochs']}</td>"]
    cells.append(_three(common["ekf_rmse_m"], ".3f"))
    cells.append(_three(common["triangulation_rmse_m"], ".3f"))
    telling = common["improvement_percent"] if common["epochs"] >= FEW_EPOCHS else None
    cells.append(_three(telling, "+.0f", " %"))
    cells.append(_three(ratio, ".2f"))
    return f"<tr class='{kind}'>{''.join(cells)}</tr>"


def _three(values: Sequence[float | None] | None, form: str, unit: str = "") -> str:
    """Return three cells, dashes where there is no value."""
    shown = ["–" if v is None else format(v, form) + unit for v in (values or (None, None, None))]
    return f"<td class=first>{shown[0]}</td><td>{shown[1]}</td><td>{shown[2]}</td>"


def _triple(values: Iterable[float]) -> str:
    """Format x / y / z in metres."""
    return " / ".join(f"{v:.3f}" for v in values)


def _gallery(shown: list[Picture]) -> str:
    """Return the pictures with their captions."""
    if not shown:
        return ""
    figures = "".join(
        f"<figure><h3>{escape(p.title)}</h3>{p.svg}<figcaption>{escape(p.caption)}</figcaption></figure>" for p in shown
    )
    return f"<h2>Pictures</h2><div class='pictures'>{figures}</div>"


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
            "pairs, beside a constant bias.</p>"
            + ("<p>By the session's word the two clocks are one, so it is not applied.</p>" if one else "")
        )
    rows = "".join(
        f"<tr><td>{s['from_s']:.2f} – {s['to_s']:.2f} s</td><td>{s['reason']}</td>"
        f"<td class=text>{escape(s['detail'])}</td></tr>"
        for s in reference["excluded"]
    )
    spans = (
        "<div class='wide'><table><thead><tr><th>session time</th><th>left out as</th><th class=text>because</th></tr>"
        f"</thead><tbody>{rows}</tbody></table></div>"
        if rows
        else "<p>Nothing of the log was left out.</p>"
    )
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
    rows = "".join(
        f"<tr><td>{escape(word.replace('_', ' '))}</td><td>{n}</td>"
        f"<td class=text><span class=bar style='width:{150 * n / most:.0f}px'></span></td></tr>"
        for word, n in counts.items()
        if n
    )
    return f"<div><h3>{escape(title)}</h3><table><tbody>{rows or '<tr><td>nothing</td></tr>'}</tbody></table></div>"


def _events(events: Sequence[tuple[float, str, str]]) -> str:
    """Return the log of the run, folded."""
    if not events:
        return ""
    lines = "\n".join(f"{t:9.3f} s  {level:<8} {text}" for t, level, text in events)
    return f"<h2>Log</h2><details><summary>{len(events)} events</summary><pre>{escape(lines)}</pre></details>"


def _appendix(summary: dict[str, Any]) -> str:
    """Return configuration and versions."""
    configuration = escape(json.dumps(summary["configuration"], indent=1, ensure_ascii=False))
    versions = "".join(f"<tr><td>{escape(k)}</td><td>{escape(v)}</td></tr>" for k, v in summary["versions"].items())
    return (
        "<h2>Configuration and versions</h2>"
        f"<details><summary>Resolved configuration</summary><pre>{configuration}</pre></details>"
        "<details open><summary>Versions</summary>"
        f"<div class='wide'><table><tbody>{versions}</tbody></table></div></details>"
    )
