"""Observations of the aircraft by a site's stations, and the sensitivity of the pixels to each error source."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.bounds import StationView
from groundstation.evaluation.calibration_bounds import calibration_sensitivities, joint_information
from groundstation.geometry.aim import aim_at
from groundstation.geometry.station import StationGeometry
from groundstation.planning.error_sources import CAMERA_CLOCK, PTU_CLOCK, STATION_CLOCK, error_sources
from groundstation.planning.site import Site
from groundstation.rig.rig import Station


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observation:
    """One station's look at the aircraft.

    Attributes
    ----------
    view : geometry, angles and noise.
    by_source : (2, m) ∂pixel/∂source, in the order of the observer's sources.
    silhouette_px : width of the wing span. field_m : what the picture's width spans at that distance.
    turn_rad_s : the faster of the rates of pan and tilt that follow it.
    """

    view: StationView
    by_source: FloatArray
    silhouette_px: float
    field_m: float
    turn_rad_s: float


class Observer:
    """The stations of a site with their geometry packed once, and its error sources."""

    __slots__ = ("_clocks", "_geometries", "site", "sources")

    def __init__(self, site: Site) -> None:
        self.site = site
        self.sources = error_sources(site)
        later = enumerate(self.sources.names[self.sources.calibrated :], start=self.sources.calibrated)
        self._clocks = {(name.partition(".")[0], name.partition(".")[2]): k for k, name in later}
        self._geometries = tuple(station.geometry() for station in site.rig.stations)

    def observations(self, point_runway_m: FloatArray, velocity_m_s: FloatArray) -> list[Observation]:
        """Return the observations of the stations whose picture contains a nose at a point (3,), moving at (3,)."""
        found = []
        for station, geometry in zip(self.site.rig.stations, self._geometries, strict=True):
            seen = self._look(station, geometry, point_runway_m, velocity_m_s)
            if seen is not None:
                found.append(seen)
        return found

    def information(self, point_runway_m: FloatArray, observations: Sequence[Observation]) -> FloatArray:
        """Return the information (3 + m, 3 + m) of several observations of the point and the sources together."""
        if not observations:
            return np.zeros((3 + len(self.sources.names), 3 + len(self.sources.names)))
        return joint_information(point_runway_m, [s.view for s in observations], [s.by_source for s in observations])

    def _look(
        self, station: Station, geometry: StationGeometry, point: FloatArray, velocity_m_s: FloatArray
    ) -> Observation | None:
        """Return one station's look, its PTU turned to the point; None where it cannot see it."""
        pan_rad = tilt_rad = 0.0
        if not station.fixed:
            aimed = aim_at(geometry, point)
            if aimed is None:
                return None
            pan_rad, tilt_rad = aimed.pan_rad, aimed.tilt_rad
        projected = geometry.project(point, pan_rad, tilt_rad)
        if projected is None or not geometry.contains(projected.pixel):
            return None
        view = StationView(
            geometry=geometry,
            pan_rad=pan_rad,
            tilt_rad=tilt_rad,
            pixel_covariance_px2=self.site.pixel_sigma_px**2 * np.eye(2),
            angle_sigma_rad=0.0 if station.fixed else station.angle_sigma_rad,
        )
        moved = projected.jacobian[:, :3] @ velocity_m_s
        by_angle = projected.jacobian[:, 3:]
        # the PTU holds the aircraft in the picture: what the motion moves, the turning takes back
        rates = np.zeros(2) if station.fixed else -np.linalg.solve(by_angle, moved)
        turned = by_angle @ rates
        focal_px = float(station.lens.focal_px[0])
        return Observation(
            view=view,
            by_source=self._by_source(
                view, point, {STATION_CLOCK: moved, CAMERA_CLOCK: moved + turned, PTU_CLOCK: -turned}
            ),
            silhouette_px=self.site.aircraft.span_m * focal_px / projected.depth_m,
            field_m=station.lens.image_size_px[0] * projected.depth_m / focal_px,
            turn_rad_s=float(np.abs(rates).max()),
        )

    def _by_source(self, view: StationView, point: FloatArray, by_clock: dict[str, FloatArray]) -> FloatArray:
        """Return ∂pixel/∂source (2, m): px per unit of calibration, px per s of clock."""
        names, calibrated = self.sources.names, self.sources.calibrated
        by_source = np.zeros((2, len(names)))
        by_source[:, :calibrated] = calibration_sensitivities(point, [view], names[:calibrated])[0]
        for kind, moved in by_clock.items():
            k = self._clocks.get((view.geometry.name, kind))
            if k is not None:
                by_source[:, k] = moved
        return by_source
