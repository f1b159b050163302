"""report.html of a flight's calibration: the verdict first, then parameters, residuals, omissions."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.flight.fit import FlightFit
from calibration.flight.report_pictures import flight_pictures
from calibration.flight.text_report import antenna_line, gross_times, lasting_lines, parameter_row
from calibration.flight.verdict import FlightVerdict
from calibration.report.picture import ReportPicture, shown, write_page
from groundstation.files.html_page import (
    bullet_list,
    html_page,
    page_header,
    soft_line,
    text_table,
    verdict_line,
)
from groundstation.rig.rig import Rig
from groundstation.session.antenna import AntennaPosition

_WORDS = (1,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightPage:
    """Content of the page.

    ``notes`` are lines on decisions; ``excluded`` on omissions; ``antenna`` where the fit began.
    """

    session: str
    before: Rig
    after: Rig
    fit: FlightFit
    verdict: FlightVerdict
    notes: Sequence[str]
    excluded: Sequence[str]
    antenna: AntennaPosition


def write_flight_page(folder: Path, content: FlightPage) -> list[Path]:
    """Write report.html and the pictures as PNG into ``folder``, created if missing; returns the written files."""
    pictures = flight_pictures(content.after, content.fit, content.verdict)
    return write_page(folder, flight_page(content, pictures), pictures)


def flight_page(content: FlightPage, pictures: Sequence[ReportPicture]) -> str:
    """Return the page; it loads nothing from anywhere."""
    verdict, fit = content.verdict, content.fit
    parts = [
        page_header("calibrated on a flight", content.session),
        verdict_line(verdict.summary),
    ]
    if verdict.apart:
        parts.append("<h2>What this flight does not determine</h2>" + bullet_list(verdict.apart))
    parts += [
        "<h2>What to do next</h2>" + bullet_list(verdict.next_steps),
        _ranges(verdict),
        "<h2>Notes</h2>"
        + bullet_list([*content.notes, *lasting_lines(fit), antenna_line(fit, content.antenna), *verdict.notes]),
        "<h2>Pictures</h2>" + shown(pictures),
        "<h2>What was found</h2>" + _parameters(content),
        "<h2>How the pixels fit</h2>" + _stations(fit),
        "<h2>What was left out</h2>" + bullet_list(content.excluded or ["nothing of the DGPS"]),
    ]
    return html_page(f"{content.session} – flight", "\n".join(parts))


def _ranges(verdict: FlightVerdict) -> str:
    if not verdict.ranges:
        return ""
    rows = []
    for q in verdict.ranges:
        where = f"{q.range_m:.0f} m" + ("" if q.flown else ", not flown")
        numbers = [f"{v:.3f}" for v in (*q.calibration_m, *q.noise_m)]
        rows.append([where, *numbers, "yes" if q.good else "no"])
    heads = ["range", *(f"{axis}, m" for axis in ("along", "across", "up")), "one fix along, m", "across, m", "up, m"]
    return (
        "<h2>What that is in the air</h2>"
        + soft_line(
            "One sigma of what is left of the calibration's error, next to the noise of one fix by pixels and "
            "encoders; good where the first is not above the second."
        )
        + text_table([*heads, "good"], rows)
    )


def _parameters(content: FlightPage) -> str:
    fit, rows = content.fit, []
    for k, name in enumerate(fit.problem.names):
        row = parameter_row(content.before, content.after, fit, k)
        rows.append([name, row.value, row.sigma, row.change, row.unit, f"{fit.lasting_factor[k]:.1f}"])
    heads = ["parameter", "value", "1 σ", "change", "unit", "raised by"]
    note = "so many times the sigma of noise that averages out, because of errors that last longer than a frame"
    return text_table(heads, rows) + soft_line(f"Raised by: {note}.")


def _stations(fit: FlightFit) -> str:
    rows = []
    for name, station in fit.stations.items():
        usable, kept, count = int(station.usable.sum()), int(station.kept.sum()), len(station.usable)
        numbers = [f"{station.rms_px:.2f}", str(kept), str(usable - kept), str(count - usable)]
        rows.append([name, *numbers, gross_times(fit, name).strip(" ()")])
    return text_table(["station", "rms, px", "pixels", "gross", "without angle or DGPS", "when"], rows)
