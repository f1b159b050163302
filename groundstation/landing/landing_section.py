"""Landing reports as a section of the page on a run: touchdowns, what had been foretold of them, what was said."""

from collections.abc import Sequence
from html import escape

from groundstation.files.html_page import Column, page_table, plain
from groundstation.landing.landing_report import LandingReport, WorstSigma

_UNKNOWN = "–"
_LANDINGS = (
    Column("approach"),
    Column("ended as", text=True),
    Column("touchdown, s"),
    Column("past the threshold, m"),
    Column("right of the line, m"),
    Column("sink, m/s"),
    Column("ground speed, m/s"),
    Column("over the threshold at, m"),
    Column("off the glide path, rms, m"),
    Column("off the centre line, rms, m"),
)
_FORECASTS = (
    Column("approach"),
    Column("foretold before, s"),
    Column("off along, m"),
    Column("off to the right, m"),
    Column("late, s"),
    Column("half axes of the ellipse, m"),
    Column("touchdown", text=True),
)
_SIGMAS = (Column("approach"), Column("worst sigma", text=True), Column("m"), Column("where", text=True))


def landing_section(reports: Sequence[LandingReport]) -> str:
    """Return the section; "" of no approach."""
    if not reports:
        return ""
    parts = [
        "<h2>Landings</h2>",
        page_table(_LANDINGS, [("", _landing_cells(report)) for report in reports]),
        "<p class='soft'>Found by the track alone; ± is 1 σ. The point of the touchdown is that of the wheels.</p>",
    ]
    forecasts = [("", cells) for report in reports for cells in _forecast_cells(report)]
    if forecasts:
        parts += ["<h3>Touchdowns foretold</h3>", page_table(_FORECASTS, forecasts)]
    sigmas = [("", cells) for report in reports for cells in _sigma_cells(report)]
    parts += [page_table(_SIGMAS, sigmas), *(_said(report) for report in reports if report.events)]
    return "".join(parts)


def _landing_cells(report: LandingReport) -> list[str]:
    down = report.touchdown
    touchdown = [_UNKNOWN] * 5
    if down is not None:
        touchdown = [
            f"{down.t_s:.2f} ± {down.sigma_t_s:.2f}",
            f"{down.point_m[0]:.1f} ± {down.sigma_m[0]:.1f}",
            f"{down.point_m[1]:+.2f} ± {down.sigma_m[1]:.2f}",
            f"{down.sink_m_s:.2f} ± {down.sigma_sink_m_s:.2f}",
            f"{down.ground_speed_m_s:.1f}",
        ]
    height_m, path = report.threshold_height_m, report.glide_path
    return [
        str(report.number),
        plain(str(report.outcome)),
        *touchdown,
        _UNKNOWN if height_m is None else f"{height_m:.1f}",
        _UNKNOWN if path is None else f"{path.rms_m:.2f}",
        f"{report.centre_line.rms_m:.2f}",
    ]


def _forecast_cells(report: LandingReport) -> list[list[str]]:
    return [
        [
            str(report.number),
            f"{check.before_s:.0f}",
            f"{check.along_off_m:+.1f}",
            f"{check.right_off_m:+.1f}",
            f"{check.late_s:+.1f}",
            " × ".join(f"{half_m:.1f}" for half_m in check.half_axes_m),
            "inside" if check.inside else "outside",
        ]
        for check in report.forecasts
    ]


def _sigma_cells(report: LandingReport) -> list[list[str]]:
    return [
        [str(report.number), plain(name), f"{worst.sigma_m:.2f}", plain(_place(worst))]
        for name, worst in report.worst.items()
    ]


def _place(worst: WorstSigma) -> str:
    side = "before" if worst.to_threshold_m >= 0.0 else "past"
    return f"{abs(worst.to_threshold_m):.0f} m {side} the threshold, at {worst.t_s:.1f} s"


def _said(report: LandingReport) -> str:
    lines = "\n".join(f"{event.t_s:9.3f} s  {event.text}" for event in report.events)
    title = f"approach {report.number}: {len(report.events)} calls and changes"
    return f"<details><summary>{title}</summary><pre>{escape(lines)}</pre></details>"
