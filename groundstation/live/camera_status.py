"""Status text of a camera: lost frames, and the offset of its clock from this machine's."""

from groundstation.sources.cameras.camera import CameraCounts
from groundstation.sources.cameras.host_clock_fit import ClockFitConfig, ClockFitState

_SETTLED = ClockFitConfig().settled
# an offset with a larger sigma is of no use and not shown
_COARSE_S = 0.1


def clock_status(clock: ClockFitState | None, *, has_clock: bool) -> str:
    """Return offset, drift, envelope and sigma of a device's clock in a few words; "" while nothing is known yet."""
    if clock is None:
        return "" if has_clock else "no clock of its own: stamped on arrival"
    if clock.bins < _SETTLED or clock.sigma_s > _COARSE_S:
        return "its clock is still being found"
    ahead = "ahead of" if clock.offset_s < 0.0 else "behind"
    return (
        f"its clock {abs(clock.offset_s):.4f} s {ahead} ours, drifts {round(1e6 * clock.drift) or 0:+d} ppm, "
        f"pictures {1e3 * clock.spread_s:.2f} ms later than the quickest, known to ± {1e3 * clock.sigma_s:.2f} ms"
    )


def lost_frames(now: CameraCounts, before: CameraCounts) -> str:
    """Return which frames did not come through since ``before``; "" for none."""
    missing = {
        "incomplete": now.incomplete - before.incomplete,
        "lost": now.lost - before.lost,
        "dropped": now.dropped - before.dropped,
    }
    return ", ".join(f"{n} {what}" for what, n in missing.items() if n)
