"""The report's tables: accuracy with its bounds, calibration and clocks found."""

from collections.abc import Iterable
from html import escape
from typing import Any

from groundstation.evaluation.accuracy_table import FEW_EPOCHS, shown_unit
from groundstation.files.html_page import Column, axes_cell, page_table, plain

_REFERENCES = {"truth": "Against the truth", "dgps": "Against DGPS"}
_ACCURACY = (
    Column(""),
    Column("pairs"),
    Column("EKF RMSE, m", axes=True),
    Column("triangulation RMSE, m", axes=True),
    Column("EKF better by, %", axes=True),
    Column("bound of the track, m", axes=True),
    Column("EKF / its bound", axes=True),
    Column("triang. / bound of one fix", axes=True),
)
_NOT_LEARNT = "not estimated"


def accuracy_section(name: str, table: dict[str, Any]) -> str:
    """Return one reference's accuracy: in total, by range and by background, with triangulation and bounds."""
    rows = [_accuracy_row("all", table["total"], "total")]
    for group in table["by_range"]:
        upper = f" – {group['to_m']:.0f}" if group["to_m"] is not None else " and more"
        rows.append(_accuracy_row(f"y {group['from_m']:.0f}{upper} m", group))
    rows += [_accuracy_row(f"{k} behind", g) for k, g in table["by_phase"].items() if g["reference_epochs"]]
    ekf, points = table["total"]["ekf"], table["total"]["triangulation"]
    note = (
        "EKF and triangulation on the same pairs; the ratios to the bounds on all pairs of each. With a reference at "
        f"{table['total']['reference_epochs']} pairs, the EKF has an estimate at {100 * ekf['coverage']:.1f} % of "
        f"them, triangulation at {100 * points['coverage']:.1f} %."
    )
    for method, own in (("EKF", ekf), ("Triangulation", points)):
        if own["rmse_m"]:
            note += (
                f" {method} on all of its pairs: RMSE {_triple(own['rmse_m'])} m, mean {_triple(own['mean_m'])} m, "
                f"95 % within {_triple(own['p95_m'])} m, worst {_triple(own['max_m'])} m (x / y / z)."
            )
    if table["anees"]:
        a = table["anees"]
        note += f" ANEES {a['mean']:.2f}; {a['low_95']:.2f} to {a['high_95']:.2f} for independent errors."
    note += (
        " The bounds are Cramér and Rao's by the pixel noise that the detector states: below 1 it states too much, "
        "above 1 better accuracy is possible."
    )
    return (
        f"<h2>{_REFERENCES.get(name, escape(name))}</h2>{page_table(_ACCURACY, rows)}"
        f"<p class='soft'>{note}</p>{_smoothed(table.get('smoothed'))}"
    )


def _accuracy_row(name: str, group: dict[str, Any], kind: str = "") -> tuple[str, list[str]]:
    """Return one row of the accuracy table."""
    common, bound = group["common"], group["bound"]
    telling = common["improvement_percent"] if common["epochs"] >= FEW_EPOCHS else None
    return kind, [
        plain(name),
        str(common["epochs"]),
        axes_cell(common["ekf_rmse_m"], ".3f"),
        axes_cell(common["triangulation_rmse_m"], ".3f"),
        axes_cell(telling, "+.0f"),
        axes_cell(bound["track_sigma_m"], ".3f"),
        axes_cell(bound["ekf_over_track"], ".2f"),
        axes_cell(bound["triangulation_over_fix"], ".2f"),
    ]


def _smoothed(smoothed: dict[str, Any] | None) -> str:
    """Say what looking back from the flight's end gains."""
    if smoothed is None or not smoothed["epochs"] or not smoothed["ekf_rmse_m"]:
        return ""
    honest = f" ANEES {smoothed['anees']['mean']:.2f}." if smoothed["anees"] else ""
    return (
        f"<p>Smoothed over the whole flight: RMSE {_triple(smoothed['rmse_m'])} m at {smoothed['epochs']} pairs; the "
        f"EKF there {_triple(smoothed['ekf_rmse_m'])} m (x / y / z).{honest}</p>"
    )


def calibration_section(calibration: dict[str, Any]) -> str:
    """Return what the filter carried of the rig's and the clocks' errors, and what it learnt of them."""
    errors = calibration["errors"]
    if not errors:
        return "<h2>Calibration and clocks</h2><p>The rig file states no uncertainty, so none was carried.</p>"
    until_s = calibration["learnt_until_s"]
    may_learn = until_s is not None or calibration["use"] == "estimate"
    rows = []
    for error in errors:
        unit, scale = shown_unit(error["name"])
        learnt = error["estimated"] and may_learn
        found = f"{scale * error['value']:+.4f} ± {scale * error['sigma']:.4f} {unit}"
        rows.append(
            (
                "",
                [
                    plain(error["name"].replace("_", " ").replace(".", " · ")),
                    "learnt" if learnt else "carried",
                    plain(found if learnt else _NOT_LEARNT),
                    plain(f"± {scale * error['prior_sigma']:.4f} {unit}"),
                ],
            )
        )
    taught = "" if until_s is None else f" DGPS taught until {until_s:.2f} s; those pairs are not compared with it."
    columns = (Column("error of"), Column("use"), Column("found, 1 σ"), Column("before, 1 σ"))
    return (
        "<h2>Calibration and clocks</h2><p>Errors of rig and clocks whose uncertainty is in the track's covariance."
        f"{taught}</p>{page_table(columns, rows)}"
    )


def _triple(values: Iterable[float]) -> str:
    """Format x / y / z in metres."""
    return " / ".join(f"{v:.3f}" for v in values)
