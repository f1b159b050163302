"""The pictures of a survey: observations, residuals, quality."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from calibration.landmarks.survey import Survey, inlier_landmarks, station_observations
from calibration.report.drawing import TITLED, png_of
from calibration.report.picture import ReportPicture
from calibration.rig_reach import reach_at

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")


def survey_pictures(survey: Survey) -> list[ReportPicture]:
    """Draw all pictures; needs no window system."""
    return [
        ReportPicture(
            name=name,
            title=title,
            caption=caption,
            png=png_of(draw, survey, style=TITLED),
        )
        for name, title, caption, draw in (
            (
                "map",
                "Observations by station",
                "From above. Lines of sight that are dashed were left out. Landmarks in many directions and at many "
                "distances fix a pose; along one bearing they do not.",
                _map,
            ),
            (
                "residuals",
                "What is left over",
                "Each sighting's distance from where it is predicted, in sigmas of encoder and pixel noise; hollow: "
                "left out. Noise alone is below 3.",
                _residuals,
            ),
            (
                "reach",
                "What the calibration's error does",
                "One sigma of a position at a range, by calibration alone; pixel noise comes on top.",
                _reach,
            ),
        )
    ]


def _map(figure: Figure, survey: Survey) -> None:
    ax = figure.subplots()
    points = [m for m in survey.fit.problem.landmarks if m.kind == "point" and m.place is not None]
    for colour, (name, _) in zip(_cycle(), _seen(survey), strict=False):
        x, y = survey.rig[name].ptu_position_m[:2]
        kept = inlier_landmarks(survey.fit, name)
        own = {s.landmark for observed, _ in station_observations(survey.fit, name) for s in observed.sightings}
        for mark in points:
            if mark.name in own and mark.place is not None:
                dashed = "-" if mark.name in kept else "--"
                ax.plot([x, mark.place[0]], [y, mark.place[1]], dashed, lw=0.9, color=colour, alpha=0.7)
        ax.plot(x, y, "s", ms=8, color=colour, label=name)
    for mark in points:
        if mark.place is not None:
            ax.plot(*mark.place[:2], "o", ms=6, color="#1b1f24")
            ax.annotate(
                mark.name,
                (float(mark.place[0]), float(mark.place[1])),
                xytext=(6, 4),
                textcoords="offset points",
                fontsize=11,
            )
    ax.set_aspect("equal", adjustable="datalim")
    ax.grid(color="#dddddd", lw=0.7)
    ax.set_xlabel("x in m")
    ax.set_ylabel("y in m, along the runway")
    ax.legend(frameon=False, loc="best")


def _residuals(figure: Figure, survey: Survey) -> None:
    ax = figure.subplots()
    names = [m.name for m in survey.fit.problem.landmarks]
    seen = list(_seen(survey))
    for place, (colour, (name, _)) in enumerate(zip(_cycle(), seen, strict=False)):
        for observed, rows in station_observations(survey.fit, name):
            spread = np.linspace(-0.14, 0.14, len(rows)) + 0.36 * (place - 0.5 * (len(seen) - 1)) / max(
                len(seen) - 1, 1
            )
            length = np.minimum(survey.fit.length[rows], 30.0)
            kept = survey.fit.kept[rows]
            ax.plot((observed.landmark + spread)[kept], length[kept], ".", ms=6, color=colour, label=name)
            ax.plot((observed.landmark + spread)[~kept], length[~kept], "o", ms=6, mfc="none", color=colour)
    ax.set_xticks(range(len(names)), names, rotation=30, ha="right")
    top = float(np.min([30.0, np.max([3.0, *survey.fit.length])]))
    ax.set_ylim(0.0, 1.15 * top)
    ax.grid(axis="y", color="#dddddd", lw=0.7)
    ax.set_ylabel("residual in sigmas")
    ax.legend(frameon=False, loc="upper right", ncols=min(len(seen), 4), borderaxespad=0.0)


def _reach(figure: Figure, survey: Survey) -> None:
    ax = figure.subplots()
    ranges = np.geomspace(50.0, 800.0, 30)
    reached = [value for value in (reach_at(survey.rig, float(r)) for r in ranges) if value is not None]
    at = [value.range_m for value in reached]
    lines = (
        ("along the runway", [v.along_m for v in reached]),
        ("across", [v.across_m for v in reached]),
        ("up", [v.up_m for v in reached]),
    )
    for colour, (label, values) in zip(_COLOURS, lines, strict=False):
        ax.loglog(at, values, lw=2, color=colour, label=label)
    ax.grid(which="both", color="#e6e6e6", lw=0.7)
    ax.set_xticks([50, 100, 200, 400, 800], ["50", "100", "200", "400", "800"])
    ax.minorticks_off()
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.set_xlabel("range in m")
    ax.set_ylabel("1 σ in m")
    ax.legend(frameon=False)
    if not reached:
        ax.set_title("a position needs two stations")


def _seen(survey: Survey) -> list[tuple[str, int]]:
    return [(observed.station, len(observed)) for observed in survey.fit.problem.observations]


def _cycle() -> list[str]:
    return list(_COLOURS) * 11
