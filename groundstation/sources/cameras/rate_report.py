"""Statistics of a few seconds of a camera: rate, jitter, latency, clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.sources.cameras.camera import CameraCounts, CameraFrame, SettingsReadBack
from groundstation.sources.cameras.host_clock_fit import ClockFitState


@dataclass(frozen=True, slots=True, kw_only=True)
class RateReport:
    """Over ``frames`` frames: rate, Hz; times between neighbours by the device's clock and at arrival, s.

    ``device_jitter_s`` is None without a device clock; ``sigma_s`` is the last frame's; ``late_s`` is from mid-exposure
    to arrival, median and maximum. Where frames were lost or the camera was absent, there are no neighbours.
    """

    frames: int
    rate_hz: float
    device_jitter_s: float | None
    arrival_jitter_s: float
    late_s: tuple[float, float]
    sigma_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTimes:
    """The fields of a frame that a report uses: all but its picture."""

    index: int
    opening: int
    device_ns: int | None
    arrival_s: float
    t_s: float
    sigma_s: float


def frame_times(frame: CameraFrame) -> FrameTimes:
    """Return a frame's times, so that its picture need not be kept."""
    return FrameTimes(
        index=frame.index,
        opening=frame.opening,
        device_ns=frame.device_ns,
        arrival_s=frame.arrival_s,
        t_s=frame.t_s,
        sigma_s=frame.sigma_s,
    )


def rate_report(frames: Sequence[FrameTimes]) -> RateReport | None:
    """Return the report; None for fewer than three frames."""
    if len(frames) < 3:
        return None
    arrival = np.array([f.arrival_s for f in frames])
    times = np.array([f.t_s for f in frames])
    index = np.array([f.index for f in frames])
    together = np.diff([f.opening for f in frames]) == 0
    neighbours = (np.diff(index) == 1) & together
    # frames that the camera made, lost ones too, over the time that it ran
    made, ran_s = np.diff(index)[together].sum(), np.diff(times)[together].sum()
    stamps = [f.device_ns for f in frames if f.device_ns is not None]
    device_jitter = None
    if len(stamps) == len(frames) and neighbours.any():
        device_jitter = float(np.std(np.diff(np.array(stamps, np.int64))[neighbours])) * 1e-9
    late = arrival - times
    return RateReport(
        frames=len(frames),
        rate_hz=float(made / ran_s) if ran_s > 0.0 else 0.0,
        device_jitter_s=device_jitter,
        arrival_jitter_s=float(np.std(np.diff(arrival)[neighbours])) if neighbours.any() else 0.0,
        late_s=(float(np.median(late)), float(late.max())),
        sigma_s=frames[-1].sigma_s,
    )


def format_settings(found: SettingsReadBack) -> str:
    """Return the settings that a camera reports, a line each, with a note for those that it does not."""
    rows = [
        ("camera", found.model + (f", {found.serial}" if found.serial else "")),
        ("picture", _or_unknown(found.size_px and f"{found.size_px[0]} × {found.size_px[1]} px")),
        ("region", _or_unknown(found.roi_px and "x {}, y {}, {} × {} px".format(*found.roi_px))),
        ("pixel format", _or_unknown(found.pixel_format)),
        ("exposure", _or_unknown(None if found.exposure_s is None else f"{found.exposure_s * 1e3:.3f} ms")),
        ("gain", _or_unknown(None if found.gain is None else f"{found.gain:g}")),
        ("rate set", _or_unknown(None if found.rate_hz is None else f"{found.rate_hz:.3g} Hz")),
        ("trigger", _or_unknown(found.trigger)),
    ]
    return "\n".join(f"{name:<14}{value}" for name, value in rows)


def format_rate(report: RateReport | None, counts: CameraCounts, clock: ClockFitState | None) -> str:
    """Return rate, jitter, clock and counts, a line each."""
    rows = []
    if report is None:
        rows.append(("measured", "too few frames"))
    else:
        device = "" if report.device_jitter_s is None else f", {report.device_jitter_s * 1e3:.3f} ms by its own clock"
        rows += [
            ("measured", f"{report.rate_hz:.3f} Hz over {report.frames} frames"),
            ("jitter", f"{report.arrival_jitter_s * 1e3:.3f} ms at arrival{device}"),
            (
                "arrives",
                f"{report.late_s[0] * 1e3:.1f} ms after the frame's time, at worst {report.late_s[1] * 1e3:.1f} ms",
            ),
            ("stamps", f"± {report.sigma_s * 1e3:.3f} ms (1 σ)"),
        ]
    if clock is None and report is not None and report.device_jitter_s is not None:
        rows.append(("clock", "none to be fitted: a frame of a file has the time at which it is due"))
    elif clock is None:
        rows.append(("clock", "the camera has none; frames are stamped by their arrival"))
    else:
        drift = f"drift {clock.drift * 1e6:+.1f} ± {clock.drift_sigma * 1e6:.1f} ppm"
        over = f"arrivals {clock.spread_s * 1e3:.3f} ms over their lower envelope"
        rows.append(("clock", f"{drift}, fit ± {clock.sigma_s * 1e3:.3f} ms, {over}"))
    lost = f"{counts.lost} lost, {counts.incomplete} incomplete, {counts.overtaken} overtaken"
    here = f"{counts.dropped} dropped here, {counts.repeated} repeated"
    rows.append(("frames", f"{counts.frames} complete, {lost}, {here}"))
    rows.append(("reconnects", f"{counts.reconnects}"))
    return "\n".join(f"{name:<14}{value}" for name, value in rows)


def _or_unknown(text: str | None) -> str:
    return "not reported" if text is None else text
