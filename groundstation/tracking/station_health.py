"""Availability and integrity of the stations of a running pipeline.

Converts the pixels of an epoch into the residuals of `groundstation.integrity.station_exclusion` and its verdict
changes into log events.
"""

from collections.abc import Mapping

from groundstation.estimation.station_ekf import StationEkf
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.leave_one_out import subtract_rig_errors
from groundstation.integrity.solution_separation import PixelResidual
from groundstation.integrity.station_exclusion import IntegrityConfig, IntegrityMonitor, StationVerdict, VerdictChange
from groundstation.messages import TrackEvent
from groundstation.tracking.epoch_buffer import EpochView, EpochViews


class StationHealth:
    """Monitors all stations of one filter; counts excluded pixels and lost stations."""

    def __init__(self, geometries: Mapping[str, StationGeometry], ekf: StationEkf, config: IntegrityConfig) -> None:
        self.monitor = IntegrityMonitor(tuple(geometries), config)
        self.lost = 0
        self.excluded_pixels = 0
        self._geometries = geometries
        self._ekf = ekf
        self._config = config
        self._newest: dict[str, float] = {}
        self._silent: set[str] = set()
        self._was_confirmed = False

    def uses(self, station: str) -> bool:
        """Return whether the pixels of a station are fused; count the pixel if not."""
        if self.monitor.verdict(station) is not StationVerdict.EXCLUDED:
            return True
        self.excluded_pixels += 1
        return False

    def delivered(self, station: str, t_s: float) -> None:
        """Record that a station has sent a frame or a pixel."""
        self._newest[station] = max(t_s, self._newest.get(station, t_s))

    def epoch(self, t_s: float, views: EpochViews, *, confirmed: bool) -> list[TrackEvent]:
        """Evaluate the pixels of one epoch; return the log events of the stations.

        A target that is not ``confirmed`` may be different things in different cameras, and tells nothing of stations.
        """
        events = self.silence(t_s)
        if not confirmed:
            if self._was_confirmed:
                self.monitor.forget()
            self._was_confirmed = False
            return events
        self._was_confirmed = True
        residuals = [s for s in (self._residual(v) for v in views.views) if s is not None]
        if len(residuals) >= 2:
            events += [_line(t_s, change) for change in self.monitor.epoch(t_s, residuals)]
        return events

    def silence(self, t_s: float) -> list[TrackEvent]:
        """Return events for stations that have stopped or resumed delivering."""
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

    def _residual(self, seen: EpochView) -> PixelResidual | None:
        """Return the residual of one pixel at its exposure, corrected for the estimated rig errors."""
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
        spread = subtract_rig_errors(
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


def _line(t_s: float, change: VerdictChange) -> TrackEvent:
    level = "info" if change.verdict is StationVerdict.TRUSTED else "warning"
    return TrackEvent(t_s=t_s, level=level, text=change.text)
