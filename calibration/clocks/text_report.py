"""The result of a calibration of clocks, in words."""

from itertools import pairwise

import numpy as np

from calibration.clocks.calibrate import ClockDifference, TimingCalibration
from calibration.clocks.ptu_clock_fit import TimingFit
from calibration.flight.parameters import FLOOR_CLOCK_S
from calibration.flight.text_report import antenna_line
from calibration.reading_scale import roll_doubt, scale_doubt
from groundstation.session.antenna import antenna_position

RANGES_M = (100.0, 200.0, 400.0)
_TURNING_DEG_S = 5.0
GOOD_S = 0.001
USABLE_S = 0.005
_AGREE_SIGMAS = 3.0


def format_timing(found: TimingCalibration) -> str:
    """Return the whole report: each station's offset, cameras against each other, both ways compared, verdict."""
    lines = []
    for name, fit in found.by_pictures.items():
        lines += [*_station(found, name, fit), ""]
    if found.by_flight is not None:
        lines += [*_flight(found), ""]
    lines += [*_cameras(found), *_compared(found), *found.notes]
    lines += ["", "verdict:", *(f"  {line}" for line in _verdict(found))]
    return "\n".join(lines)


def _ms(difference: ClockDifference) -> str:
    return f"{1e3 * difference.value_s:+.2f} +- {1e3 * difference.sigma_s:.2f} ms"


def _difference(fit: TimingFit) -> ClockDifference:
    return ClockDifference(value_s=fit.offset_s, sigma_s=fit.sigma_s)


def _station(found: TimingCalibration, name: str, fit: TimingFit) -> list[str]:
    motion = found.motions[name].motion
    windows = float(np.median(motion.sigma_rad))
    focal = float(found.session.rig[name].lens.focal_px[0])
    lines = [
        f"station {name}, by pictures: its PTU's readings are {_ms(_difference(fit))} later than the rig states;"
        f" ptu_clock offset now {1e3 * found.rig[name].ptu_clock.offset_s:.2f} ms",
        f"  {int(fit.kept.sum())} of {motion.frames} pairs of frames; {motion.plain} without texture all over,"
        f" {motion.torn} whose windows do not agree, {int((~fit.kept).sum())} that do not fit or lack readings around",
        f"  the head turned at up to {np.degrees(fit.rate_rad_s.max()):.2f} deg/s,"
        f" {np.degrees(np.sqrt(np.mean(fit.rate_rad_s**2))):.2f} rms; readings scatter by"
        f" {np.degrees(fit.reading_sigma_rad):.4f} deg; a picture's windows agree to {focal * windows:.3f} px",
        f"  found on the way: scale {1e2 * fit.scale:+.3f} %, roll {np.degrees(fit.roll_rad):+.3f} deg",
    ]
    if fit.drift_sigma is not None:
        drift = f"drift {1e6 * fit.drift:.1f} ppm" if fit.drift else "no drift beyond its noise"
        lines.append(f"  {drift}, 1 sigma {1e6 * fit.drift_sigma:.1f} ppm")
    if fit.lasting_factor > 1.0:
        lines.append(f"  sigma raised {fit.lasting_factor:.2f} times for errors that last longer than a frame")
    return lines


def _flight(found: TimingCalibration) -> list[str]:
    lines = []
    for name in found.session.rig.names:
        difference = found.flight_ptu(name)
        if difference is not None:
            lines.append(
                f"station {name}, by the flight: PTU against camera {_ms(difference)} later than the rig states"
            )
    if found.by_flight is not None:
        lines.append(antenna_line(found.by_flight, antenna_position(found.session)))
    return lines


def _cameras(found: TimingCalibration) -> list[str]:
    lines = []
    for first, other in pairwise(found.session.rig.names):
        if first in found.by_pictures and other in found.by_pictures:
            a, b = found.by_pictures[first], found.by_pictures[other]
            gap = ClockDifference(value_s=a.offset_s - b.offset_s, sigma_s=float(np.hypot(a.sigma_s, b.sigma_s)))
            lines.append(
                f"camera {other} against camera {first}, if one clock stamps both PTUs: {_ms(gap)} later than stated"
                " (--one-ptu-clock writes it)"
            )
        flown = found.flight_cameras(first, other)
        if flown is not None:
            lines.append(f"camera {other} against camera {first}, by the flight: {_ms(flown)} later than stated")
    return lines


def _compared(found: TimingCalibration) -> list[str]:
    lines = []
    for name, fit in found.by_pictures.items():
        flown = found.flight_ptu(name)
        if flown is None:
            continue
        gap, sigma = fit.offset_s - flown.value_s, float(np.hypot(fit.sigma_s, flown.sigma_s))
        word = "agree" if abs(gap) <= _AGREE_SIGMAS * sigma else "DISAGREE"
        lines.append(
            f"{name}: pictures and flight {word}: {1e3 * gap:+.2f} ms apart, {abs(gap) / sigma:.1f} sigma"
            " (the pictures' is written)"
        )
    return lines


def _ptu_sigma_s(found: TimingCalibration, name: str) -> float:
    """Return one sigma of a PTU's clock against its camera's; a flight determines only a combination of the two."""
    if name in found.by_pictures:
        return max(found.by_pictures[name].sigma_s, FLOOR_CLOCK_S)
    flown = found.flight_ptu(name)
    return found.session.rig[name].ptu_clock.sigma_s if flown is None else max(flown.sigma_s, FLOOR_CLOCK_S)


def _verdict(found: TimingCalibration) -> list[str]:
    sigmas = {s.name: _ptu_sigma_s(found, s.name) for s in found.rig.stations if not s.fixed}
    worst = max(sigmas, key=lambda name: sigmas[name])
    sigma = sigmas[worst]
    word = "good" if sigma <= GOOD_S else "usable" if sigma <= USABLE_S else "not good enough"
    off = _TURNING_DEG_S * sigma
    parts = ", ".join(f"{away * np.radians(off):.3f} m at {away:.0f} m" for away in RANGES_M)
    lines = [
        f"{word}: PTU against camera to {1e3 * sigma:.2f} ms or better (1 sigma, {worst})",
        f"a head that turns at {_TURNING_DEG_S:g} deg/s is then off by {off:.4f} deg: {parts}, across",
    ]
    for name, fit in found.by_pictures.items():
        doubts = [scale_doubt(fit.scale), roll_doubt(float(np.degrees(fit.roll_rad)))]
        lines += [f"doubtful: {name}: {doubt}" for doubt in doubts if doubt]
    if sigma <= GOOD_S:
        lines.append("next: `groundstation calibrate check` before each session, or fly")
    elif worst in found.by_pictures:
        times = (sigma / GOOD_S) ** 2
        lines.append(
            f"next: swing the PTU faster (5 deg at 0.5 Hz turns at 16 deg/s) or {times:.0f} times as long before a"
            " scene with texture"
        )
    else:
        lines.append(
            "next: swing the PTU before a scene with texture, and `calibrate timing` without --from-flight: a head that"
            " holds the aircraft hides its camera's clock"
        )
    return lines
