"""When a frame was exposed, in the host's clock: from the device's stamp, or from its arrival alone."""

import math
from dataclasses import dataclass

from groundstation.sources.cameras.camera import CameraTiming, GrabbedFrame, StampPoint
from groundstation.sources.cameras.host_clock_fit import ClockChange, ClockFit, ClockFitConfig, ClockFitState

# share of an exposure after the device's stamp
_STILL_EXPOSED = {StampPoint.START: 1.0, StampPoint.MIDDLE: 0.5, StampPoint.END: 0.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stamp:
    """Mid-exposure in the host's clock with one sigma, s; the change of the device's clock."""

    t_s: float
    sigma_s: float
    change: ClockChange


class Stamper:
    """Stamps the frames of one camera, in order of arrival.

    A transfer follows the end of the exposure: end ≤ arrival − transfer. The device's stamps are converted to it
    before the clock is fitted, so that a changed exposure does not appear as a changed clock.
    """

    def __init__(self, timing: CameraTiming, config: ClockFitConfig | None = None) -> None:
        self._timing = timing
        self._fit = ClockFit(config)

    def restart(self) -> None:
        """Forget the device's clock: it has been reopened."""
        self._fit.restart()

    @property
    def clock(self) -> ClockFitState | None:
        """The device's clock against the host's; None without one."""
        return self._fit.state

    def stamp(
        self,
        grab: GrabbedFrame,
        arrival_s: float,
        exposure_s: float | None,
        transfer_s: float | None,
        transfer_sigma_s: float | None,
    ) -> Stamp:
        """Return a frame's exposure time; ``transfer_s`` is the estimate of the kind of camera, None from its size."""
        timing = self._timing
        exposure = timing.exposure_s if exposure_s is None else exposure_s
        if grab.due_s is not None:
            # a file's frame has no other time than the one it is played at
            return Stamp(t_s=grab.due_s, sigma_s=0.0, change=ClockChange.NONE)
        reckoned = grab.payload_bytes * 8e-6 / timing.link_mbit_s if transfer_s is None else transfer_s
        transfer = reckoned if timing.transfer_s is None else timing.transfer_s
        sigma = timing.transfer_sigma_s
        if sigma is None:
            sigma = transfer / 2.0 if transfer_sigma_s is None else transfer_sigma_s
        if grab.device_ns is None:
            return Stamp(t_s=arrival_s - transfer - exposure / 2.0, sigma_s=sigma, change=ClockChange.NONE)
        end_ns = grab.device_ns + round(_STILL_EXPOSED[timing.stamp] * exposure * 1e9)
        reading = self._fit.take(end_ns, arrival_s - transfer)
        return Stamp(
            t_s=reading.t_s - exposure / 2.0, sigma_s=math.hypot(reading.sigma_s, sigma), change=reading.change
        )
