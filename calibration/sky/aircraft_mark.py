"""An airliner as a mark of a mount's problem: a point on a path that is known but for latency and deviations."""

from dataclasses import dataclass

import numpy as np

from calibration.mount.problem import Mark, MarkKind, lift_by_refraction
from calibration.sky.flight_path import FlightPath
from groundstation.arrays import FloatArray

LATENCY, REFRACTION = "mark adsb.latency", "mark sky.refraction"
# of the refractive index over height
_SCALE_HEIGHT_M = 8400.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftMark(Mark):
    """One pass of an airliner; its ``body_m`` rows are (picture's time from the path's middle, 0, 0)."""

    path: FlightPath

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters: the receiver's latency, the refraction, and each deviation."""
        return (LATENCY, REFRACTION, *(f"mark {self.name}.path{k}" for k in range(self.path.count)))

    def points(self, change: FloatArray, station_m: FloatArray, body_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (n, 3) and derivatives (n, 3, k): a stamp is the latency late, and light is bent."""
        latency, more, own = float(change[0]), float(change[1]), change[2:]
        t_s = body_m[:, 0] + latency
        curve, deviations = self.path.at(t_s)
        along, moving = self.path.at(t_s, derivative=1)
        place = curve + deviations @ own
        away = place - station_m
        distance = np.linalg.norm(away, axis=1)
        lifted = lift_below(away) * distance[:, None]
        derivative = np.concatenate([(along + moving @ own)[:, :, None], lifted[:, :, None], deviations], axis=2)
        return place + (1.0 + more) * lifted, derivative


def aircraft_mark(name: str, path: FlightPath, latency_s: float, refraction: float) -> AircraftMark:
    """Return the mark of a pass; one sigma of latency, s, and of the refraction, a share, that all passes have."""
    return AircraftMark(
        name=name,
        kind=MarkKind.PATH,
        place_m=path.coefficients.mean(axis=0),
        sigma=np.array([latency_s, refraction, 1.0]),
        runway_from_board=np.eye(3),
        path=path,
    )


def lift_below(away_m: FloatArray) -> FloatArray:
    """Return by how much (n, 3) refraction lifts the directions to points (n, 3) that are within the air.

    Of a star's: N₀ − mean of N along the way, over N₀, with the index N falling by e each 8.4 km.
    """
    distance = np.linalg.norm(away_m, axis=1, keepdims=True)
    height = np.maximum(away_m[:, 2:], 1.0) / _SCALE_HEIGHT_M
    share = 1.0 + np.expm1(-height) / height
    return np.asarray(share * lift_by_refraction(away_m / distance))
