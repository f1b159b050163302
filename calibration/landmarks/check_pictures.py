"""The pictures of a check: where each landmark was expected by the rig, and where it was seen."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calibration.landmarks.angles import LandmarkObservations
from calibration.landmarks.check import Check
from calibration.report.drawing import png_of
from calibration.report.picture import ReportPicture
from groundstation.arrays import FloatArray, MaskArray

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
_LEAST_SPAN_DEG = 0.015
_CAPTION = (
    "The cross is where the rig expects every landmark; small dots are the sightings, large ones each landmark's mean, "
    "hollow those left out. The ring is {alarm:g} deg. All off alike: the mount has turned in pan or tilt; off by "
    "different amounts: it leans, or a landmark is not where the table says."
)


def check_pictures(check: Check, alarm_deg: float) -> list[ReportPicture]:
    """Draw one picture for each observed station; needs no window system."""
    expected, first, pictures = expected_px(check), 0, []
    for observed in check.fit.problem.observations:
        rows = slice(first, first + len(observed))
        first += len(observed)
        if not observed.today:
            continue
        off = _off_deg(check, observed, expected[rows])
        png = png_of(_draw, check, observed.landmark, off, check.fit.kept[rows], alarm_deg)
        pictures.append(
            ReportPicture(
                name=f"{observed.station}-landmarks",
                title=f"{observed.station}: expected and seen",
                caption=_CAPTION.format(alarm=alarm_deg),
                png=png,
            )
        )
    return pictures


def expected_px(check: Check) -> FloatArray:
    """Return where all landmarks (n, 2) would have been observed, had nothing moved since the rig was calibrated."""
    problem, unknowns = check.fit.problem, check.fit.unknowns.copy()
    for movement in check.movements:
        for place in problem.places(f"{movement.station}.moved"):
            unknowns[np.flatnonzero(problem.spread[place])] = 0.0
    return problem.evaluate(unknowns).pixel_px


def _off_deg(check: Check, observed: LandmarkObservations, expected: FloatArray) -> FloatArray:
    """Return seen − expected (m, 2) to the right and up, deg."""
    focal = check.rig[observed.station].lens.focal_px
    return np.asarray(np.degrees((observed.pixel_px - expected) / focal) * (1.0, -1.0))


def _draw(
    figure: Figure, check: Check, landmark: NDArray[np.int64], off: FloatArray, kept: MaskArray, alarm_deg: float
) -> None:
    ax = figure.subplots()
    names = [mark.name for mark in check.fit.problem.landmarks]
    for colour, k in zip(_COLOURS * 11, np.unique(landmark), strict=False):
        own = landmark == k
        ax.plot(*off[own].T, ".", ms=4, alpha=0.35, color=colour)
        used = own & kept
        fill = colour if used.any() else "none"
        ax.plot(*off[used if used.any() else own].mean(axis=0), "o", ms=9, mfc=fill, color=colour, label=names[int(k)])
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    ax.plot(alarm_deg * np.cos(turn), alarm_deg * np.sin(turn), "-", lw=1, color="#9aa0a6")
    ax.plot(0.0, 0.0, "+", ms=18, mew=2, color="#1b1f24")
    span = 1.15 * max(float(np.abs(off[kept]).max(initial=0.0)), alarm_deg, _LEAST_SPAN_DEG)
    ax.set(xlim=(-span, span), ylim=(-span, span), xlabel="to the right of where expected, deg", ylabel="above it, deg")
    ax.set_aspect("equal")
    ax.grid(color="#e6e6e6", lw=0.7)
    ax.legend(frameon=False, fontsize=10, loc="upper right", ncols=2)
