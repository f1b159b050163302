"""report.html of a calibration of clocks: the pictures' motion against the encoders', as stamped and as found."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.clocks.calibrate import TimingCalibration
from calibration.clocks.image_motion import StationMotion
from calibration.clocks.ptu_clock_fit import TimingFit
from calibration.clocks.text_report import format_timing
from calibration.report.drawing import BLUE, ORANGE, png_of
from calibration.report.head_page import PagePart, station_heading, write_head_page
from calibration.report.picture import ReportPicture
from groundstation.arrays import FloatArray

_GREY = "#9aa0a6"
_AXES = ("pan", "tilt")
# more than this of a recording is a picture without detail
_SHOWN_S = 6.0
_MOTION = (
    "Dots: how fast the head turns by the pictures, each between two frames. Grey: by the readings as they are "
    "stamped, with the delay that the rig stated. Blue: the same readings {later:+.1f} ms later, as found. "
    "The quickest {shown:.0f} s."
)
_LEFT = (
    "What is left over between pictures and readings, against how quickly the head changed its speed. Grey: as "
    "stamped; blue: as found. A clock that is off shows as a slope. Orange, left out: the scene moved, or did not fit."
)


def write_timing_page(folder: Path, found: TimingCalibration) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    stations = [
        PagePart(
            heading=station_heading(name),
            pictures=[_motion(name, fit, found.motions[name]), _residual(name, fit, found.motions[name])],
        )
        for name, fit in found.by_pictures.items()
    ]
    if not stations:
        line = "The flight alone was asked for: no pictures were compared with the readings."
        stations = [PagePart(heading="Stations", verdict=[line])]
    parts = [*stations, PagePart(heading="In words", text=format_timing(found))]
    return write_head_page(folder, "clocks", found.session.name, parts)


def turned_by_readings(one: StationMotion, later_s: float) -> FloatArray:
    """Return by how much (n, 2), rad, the readings have the head turn in each pair, were they ``later_s`` later."""
    t, first = np.unique(one.readings[:, 0], return_index=True)
    angles = np.unwrap(one.readings[first, 1:], axis=0)
    ends = (
        np.stack([np.interp(at - later_s, t, angles[:, k]) for k in range(2)], axis=1)
        for at in (one.motion.from_s, one.motion.to_s)
    )
    before, after = ends
    return np.asarray(after - before)


def _motion(name: str, fit: TimingFit, one: StationMotion) -> ReportPicture:
    motion = one.motion
    middle, gap = 0.5 * (motion.from_s + motion.to_s), motion.to_s - motion.from_s
    centre = _quickest(middle, np.linalg.norm(motion.turn_rad, axis=1) / gap)
    inside = np.abs(middle - centre) <= 0.5 * _SHOWN_S

    def draw(figure: Figure) -> None:
        for k, plot in enumerate(figure.subplots(2, 1, sharex=True)):
            for later, colour in ((0.0, _GREY), (fit.offset_s, BLUE)):
                rate = np.degrees(turned_by_readings(one, later)[:, k] / gap)
                plot.plot(middle[inside], rate[inside], "-", lw=1.6, color=colour)
            seen = np.degrees(motion.turn_rad[:, k] / gap)
            plot.plot(middle[inside & fit.kept], seen[inside & fit.kept], ".", ms=5, color="#1b1f24")
            plot.plot(middle[inside & ~fit.kept], seen[inside & ~fit.kept], "x", color=ORANGE)
            plot.set_ylabel(f"{_AXES[k]}, deg/s")
        plot.set_xlabel("session time, s")

    caption = _MOTION.format(later=1e3 * fit.offset_s, shown=min(_SHOWN_S, float(np.ptp(middle))))
    return ReportPicture(name=f"{name}-motion", title="Pictures against encoder", caption=caption, png=png_of(draw))


def _residual(name: str, fit: TimingFit, one: StationMotion) -> ReportPicture:
    motion = one.motion
    gap = motion.to_s - motion.from_s
    # the effect of a late clock is the change of the rate between the frames
    found = turned_by_readings(one, fit.offset_s)
    ahead, behind = turned_by_readings(one, fit.offset_s - 0.01), turned_by_readings(one, fit.offset_s + 0.01)
    speeding = np.degrees((ahead - behind) / 0.02 / gap[:, None])

    def draw(figure: Figure) -> None:
        for k, plot in enumerate(figure.subplots(2, 1)):
            for turned, colour in ((turned_by_readings(one, 0.0), _GREY), (found, BLUE)):
                off = np.degrees(motion.turn_rad - turned)[:, k]
                plot.plot(speeding[fit.kept, k], off[fit.kept], ".", ms=5, color=colour)
            plot.plot(speeding[~fit.kept, k], np.degrees(motion.turn_rad - found)[~fit.kept, k], "x", color=ORANGE)
            limit = 1.3 * float(np.abs(np.degrees(motion.turn_rad - turned_by_readings(one, 0.0))[fit.kept]).max())
            plot.set(ylim=(-limit, limit), xlabel=f"{_AXES[k]} speeds up, deg/s²", ylabel=f"{_AXES[k]} left over, deg")

    return ReportPicture(name=f"{name}-left-over", title="What is left over", caption=_LEFT, png=png_of(draw))


def _quickest(t_s: FloatArray, rate: FloatArray) -> float:
    """Return the middle of the window in which the head turns most."""
    sums = [float(np.sum(rate[np.abs(t_s - at) <= 0.5 * _SHOWN_S] ** 2)) for at in t_s]
    return float(t_s[int(np.argmax(sums))])
