"""The stations of a running pipeline: which deliver, which agree, and what is said of it.

Puts an epoch's pixels into the terms of `groundstation.integrity.station_exclusion` and turns its findings into lines
of the log.
"""

from collections.abc import Mapping

from groundstation.estimation.ekf import StationEkf
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.leave_one_out import held_against
from groundstation.integrity.solution_separation import PixelResidual
from groundstation.integrity.station_exclusion import Finding, IntegrityConfig, IntegrityWatch, StationVerdict
from groundstation.messages import TrackEvent
from groundstation.tracking.epoch import EpochPage, EpochView


class StationHealth:
    """Watches over all stations of one filter; counts what it leaves out."""

    def __init__(self, geometries: Mapping[str, StationGeometry], ekf: StationEkf, config: IntegrityConfig) -> None:
        self.watch = IntegrityWatch(tuple(geometries), config)
        self.lost = 0
        self.excluded_pixels = 0
        self._geometries = geometries
        self._ekf = ekf
        self._config = config
        self._newest: dict[str, float] = {}
        self._silent: set[str] = set()
        self._had_target = False

    def uses(self, station: str) -> bool:
        """Return whether a station's pixels are to be fused; count it if not."""
        if self.watch.verdict(station) is not StationVerdict.EXCLUDED:
            return True
        self.excluded_pixels += 1
        return False

    def delivered(self, station: str, t_s: float) -> None:
        """Note that a station has sent a frame or a pixel."""
        self._newest[station] = max(t_s, self._newest.get(station, t_s))

    def epoch(self, t_s: float, page: EpochPage) -> list[TrackEvent]:
        """Take what was seen in one epoch, and return what is to be said of the stations."""
        events = self.silence(t_s)
        if not self._ekf.has_target:
            if self._had_target:
                self.watch.forget()
            self._had_target = False
            return events
        self._had_target = True
        sights = [s for s in (self._sight(v) for v in page.views) if s is not None]
        if len(sights) >= 2:
            events += [_line(t_s, finding) for finding in self.watch.epoch(t_s, sights)]
        return events

    def silence(self, t_s: float) -> list[TrackEvent]:
        """Say who has fallen silent, and who is back."""
        events = []
        for name, newest_s in self._newest.items():
            quiet = t_s - newest_s > self._config.silent_s
            if quiet and name not in self._silent:
                self._silent.add(name)
                self.lost += 1
                left = [other for other in self._newest if other not in self._silent]
                text = f"station {name}: nothing since {newest_s:.1f} s, {len(left)} of {len(self._newest)} left"
                events.append(TrackEvent(t_s=t_s, level="warning", text=text))
            elif not quiet and name in self._silent:
                self._silent.discard(name)
                events.append(TrackEvent(t_s=t_s, level="info", text=f"station {name}: delivers again"))
        return events

    def _sight(self, seen: EpochView) -> PixelResidual | None:
        """Hold one pixel against the prediction for its own exposure, with what the filter has learnt of the rig."""
        ekf, view = self._ekf, seen.view
        if ekf.time_s is None:
            return None
        layout, x = ekf.layout, ekf.state
        point = x[layout.position] + (seen.t_s - ekf.time_s) * x[layout.velocity]
        projection = self._geometries[seen.station].project(point, view.pan_rad, view.tilt_rad)
        known = ekf.predict_pixel(seen.station)
        if projection is None or known is None:
            return None
        residual, noise = view.pixel - projection.pixel, view.covariance_px2.copy()
        spread = held_against(
            projection.jacobian,
            known.jacobian,
            layout.constant.start,
            x,
            ekf.covariance,
            view.angle_sigma_rad,
            residual,
            noise,
        )
        return PixelResidual(
            station=seen.station,
            residual_px=residual,
            jacobian_px_per_m=projection.jacobian[:, :3],
            noise_px2=noise,
            constant_px2=0.5 * spread,
        )


def _line(t_s: float, finding: Finding) -> TrackEvent:
    level = "info" if finding.verdict is StationVerdict.TRUSTED else "warning"
    return TrackEvent(t_s=t_s, level=level, text=finding.text)
