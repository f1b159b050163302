"""Report of one approach: where and how it touched down, how it kept to its plan, and what was said meanwhile."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from groundstation.landing.touchdown import TouchdownForecast
from groundstation.landing.touchdown_detection import Touchdown
from groundstation.messages import TrackEvent

# forecasts are compared with the touchdown at these times before it
COMPARED_S = (10.0, 5.0, 2.0)


class ApproachOutcome(StrEnum):
    """How an approach ended."""

    LANDED = "landed"
    TOUCHED = "touched and flew on"
    GO_AROUND = "go-around"
    NOT_SEEN = "no touchdown seen"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviationStatistics:
    """Deviation in m over a part of an approach: number of estimates, mean, root mean square, and the largest one."""

    count: int
    mean_m: float
    rms_m: float
    largest_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstSigma:
    """Largest one sigma of a position in one direction, m, and when and how far before the threshold it was."""

    sigma_m: float
    t_s: float
    to_threshold_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForecastCheck:
    """A forecast against the touchdown: made so long before it, s; off by so much, m and s; whether inside."""

    before_s: float
    along_off_m: float
    right_off_m: float
    late_s: float
    inside: bool
    half_axes_m: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandingReport:
    """One approach.

    Attributes
    ----------
    number : 1 for the first.
    outcome : how it ended.
    from_s, to_s : session times of its first and last estimate.
    touchdown : None unless it landed.
    threshold_height_m : height of the nose over the threshold, None if it was not passed in the air.
    centre_line : deviation to the right, over the whole approach.
    glide_path : deviation above the planned path, above the height of the lower vertical alert limit; None without a
        plan or an estimate there.
    worst : largest sigmas by direction: along, lateral, vertical.
    forecasts : checked against the touchdown.
    events : status changes, wave-offs and other calls, in order.
    """

    number: int
    outcome: ApproachOutcome
    from_s: float
    to_s: float
    touchdown: Touchdown | None
    threshold_height_m: float | None
    centre_line: DeviationStatistics
    glide_path: DeviationStatistics | None
    worst: dict[str, WorstSigma]
    forecasts: tuple[ForecastCheck, ...] = ()
    events: tuple[TrackEvent, ...] = field(default=())

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON has it; what is unknown is null. Units stand in the names."""
        down = self.touchdown
        return {
            "number": self.number,
            "outcome": str(self.outcome),
            "from_s": self.from_s,
            "to_s": self.to_s,
            "touchdown": None if down is None else _touchdown_dict(down),
            "threshold_height_m": self.threshold_height_m,
            "centre_line": _statistics_dict(self.centre_line),
            "glide_path": None if self.glide_path is None else _statistics_dict(self.glide_path),
            "worst_sigma": {
                name: {"sigma_m": w.sigma_m, "t_s": w.t_s, "to_threshold_m": w.to_threshold_m}
                for name, w in self.worst.items()
            },
            "forecasts": [
                {
                    "before_s": f.before_s,
                    "along_off_m": f.along_off_m,
                    "right_off_m": f.right_off_m,
                    "late_s": f.late_s,
                    "inside": f.inside,
                    "half_axes_m": list(f.half_axes_m),
                }
                for f in self.forecasts
            ],
            "events": [{"t_s": e.t_s, "level": e.level, "text": e.text} for e in self.events],
        }

    def text(self) -> str:
        """Return the report in lines for people."""
        lines = [f"Approach {self.number}, {self.from_s:.1f} to {self.to_s:.1f} s: {self.outcome}"]
        if self.touchdown is not None:
            lines += _touchdown_lines(self.touchdown)
        if self.threshold_height_m is not None:
            lines.append(f"  over the threshold at {self.threshold_height_m:.1f} m")
        if self.glide_path is not None:
            lines.append(f"  above the glide path: {_statistics_words(self.glide_path)}")
        lines.append(f"  right of the centre line: {_statistics_words(self.centre_line)}")
        for name, worst in self.worst.items():
            lines.append(f"  worst sigma {name} {worst.sigma_m:.2f} m, at {worst.t_s:.1f} s, {_place(worst)}")
        for check in self.forecasts:
            place = "inside" if check.inside else "outside"
            off = f"{check.along_off_m:+.1f} m along, {check.right_off_m:+.1f} m to the right, {check.late_s:+.1f} s"
            lines.append(f"  foretold {check.before_s:.0f} s before: touchdown off by {off}; {place} the ellipse")
        lines += [f"  {event.t_s:.1f} s: {event.text}" for event in self.events]
        return "\n".join(lines)


def check_forecasts(forecasts: Sequence[TouchdownForecast], down: Touchdown) -> tuple[ForecastCheck, ...]:
    """Return the forecasts made nearest to each of `COMPARED_S` before a touchdown, against it."""
    found = []
    for wanted_s in COMPARED_S:
        near = [f for f in forecasts if abs(down.t_s - f.made_at_s - wanted_s) <= 0.5]
        if near:
            made = min(near, key=lambda f: abs(down.t_s - f.made_at_s - wanted_s))
            off = down.point_m - made.point_m
            found.append(
                ForecastCheck(
                    before_s=wanted_s,
                    along_off_m=float(off[0]),
                    right_off_m=float(off[1]),
                    late_s=down.t_s - made.t_s,
                    inside=made.contains(down.point_m),
                    half_axes_m=made.half_axes_m,
                )
            )
    return tuple(found)


def landing_table(reports: Sequence[LandingReport]) -> str:
    """Return several approaches as a table, one row each; what is unknown is a dash."""
    rows = [["no", "outcome", "time s", "past thr. m", "right m", "sink m/s", "speed m/s", "path rms m", "line rms m"]]
    for report in reports:
        down = report.touchdown
        places = ["-"] * 5 if down is None else _touchdown_cells(down)
        path = "-" if report.glide_path is None else f"{report.glide_path.rms_m:.2f}"
        rows.append([str(report.number), str(report.outcome), *places, path, f"{report.centre_line.rms_m:.2f}"])
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(w) if k == 1 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def statistics_of(deviations_m: Sequence[float]) -> DeviationStatistics | None:
    """Return the statistics of deviations; None of none."""
    if not deviations_m:
        return None
    values = np.array(deviations_m)
    return DeviationStatistics(
        count=values.size,
        mean_m=float(values.mean()),
        rms_m=math.sqrt(float(np.mean(values**2))),
        largest_m=float(values[int(np.argmax(np.abs(values)))]),
    )


def _touchdown_dict(down: Touchdown) -> dict[str, float]:
    return {
        "t_s": down.t_s,
        "sigma_t_s": down.sigma_t_s,
        "past_threshold_m": float(down.point_m[0]),
        "right_m": float(down.point_m[1]),
        "sigma_along_m": float(down.sigma_m[0]),
        "sigma_right_m": float(down.sigma_m[1]),
        "sink_m_s": down.sink_m_s,
        "sigma_sink_m_s": down.sigma_sink_m_s,
        "ground_speed_m_s": down.ground_speed_m_s,
    }


def _touchdown_lines(down: Touchdown) -> list[str]:
    (along, right), (sigma_along, sigma_right) = down.point_m.tolist(), down.sigma_m.tolist()
    return [
        f"  touchdown at {down.t_s:.2f} s (± {down.sigma_t_s:.2f}), {along:.1f} m past the threshold "
        f"(± {sigma_along:.1f}), {right:+.2f} m right of the centre line (± {sigma_right:.2f})",
        f"  sink at touchdown {down.sink_m_s:.2f} m/s (± {down.sigma_sink_m_s:.2f}), "
        f"ground speed {down.ground_speed_m_s:.1f} m/s",
    ]


def _touchdown_cells(down: Touchdown) -> list[str]:
    along, right = down.point_m.tolist()
    numbers = ((down.t_s, 1), (along, 1), (right, 2), (down.sink_m_s, 2), (down.ground_speed_m_s, 1))
    return [f"{value:.{digits}f}" for value, digits in numbers]


def _statistics_dict(found: DeviationStatistics) -> dict[str, float]:
    return {"count": found.count, "mean_m": found.mean_m, "rms_m": found.rms_m, "largest_m": found.largest_m}


def _statistics_words(found: DeviationStatistics) -> str:
    return f"mean {found.mean_m:+.2f} m, rms {found.rms_m:.2f} m, largest {found.largest_m:+.2f} m"


def _place(worst: WorstSigma) -> str:
    where = "before" if worst.to_threshold_m >= 0.0 else "past"
    return f"{abs(worst.to_threshold_m):.0f} m {where} the threshold"
