"""What came out of each pass: where the airliner was, what is left over in its pictures, its latency."""

from dataclasses import dataclass

import numpy as np

from calibration.sky.aircraft_mark import LATENCY
from calibration.sky.calibrate import SkyCalibration, pass_name
from calibration.sky.flight_path import OWN_LATENCY_S, FlightPath
from groundstation.arrays import FloatArray, IntArray, MaskArray

MOON_LABEL = "Moon"


@dataclass(frozen=True, slots=True, kw_only=True)
class PassPlace:
    """Where a pass was: least and greatest distance, km, and height over the horizon, degrees."""

    away_km: tuple[float, float]
    up_deg: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PassLatency:
    """By how much a pass's positions are stamped late, s: the receiver's latency and the aircraft's own, and sigma."""

    latency_s: float
    sigma_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationResiduals:
    """What is left over of n sightings of one station.

    Attributes
    ----------
    body : (n,) the pass's number; of the Moon that after the last.
    reading_deg, turned_deg : (n, 2) readings, and residuals as pan and tilt.
    kept : (n,) whether they are used.
    """

    body: IntArray
    reading_deg: FloatArray
    turned_deg: FloatArray
    kept: MaskArray

    def rms_deg(self, body: int) -> FloatArray | None:
        """Return the rms (2,) of what is left over of one pass; None where no picture of it is used."""
        own = self.kept & (self.body == body)
        return np.sqrt(np.mean(self.turned_deg[own] ** 2, axis=0)) if own.any() else None


def pass_place(path: FlightPath) -> PassPlace:
    """Return where an airliner was while its positions came."""
    place = path.at(np.linspace(*path.span_s, 9))[0]
    away = np.linalg.norm(place, axis=1)
    up = np.degrees(np.arcsin(place[:, 2] / away))
    return PassPlace(
        away_km=(float(away.min()) / 1000.0, float(away.max()) / 1000.0),
        up_deg=(max(float(up.min()), 0.0), float(up.max())),
    )


def pass_latency(found: SkyCalibration, number: int) -> PassLatency | None:
    """Return the latency of one pass; None of a pass without sightings."""
    joint = found.night.joint
    path = found.flights[number]
    own = f"mark {pass_name(number, path)}.path{path.count - 1}"
    if own not in joint.names or LATENCY not in joint.names:
        return None
    whole = np.zeros(len(joint.names))
    whole[joint.names.index(LATENCY)] = 1.0
    whole[joint.names.index(own)] = OWN_LATENCY_S
    value = 0.0
    for name, factor in ((LATENCY, 1.0), (own, OWN_LATENCY_S)):
        column = joint.names.index(name)
        k = next(k for k, columns in enumerate(joint.columns) if column in columns)
        value += factor * float(joint.change[k][joint.columns[k].index(column)])
    return PassLatency(latency_s=value, sigma_s=float(np.sqrt(whole @ joint.covariance @ whole)))


def station_residuals(found: SkyCalibration, k: int) -> StationResiduals:
    """Return what is left over of station ``k``."""
    fit = found.night.joint.nights[k].fit
    seen = fit.problem.sightings
    return StationResiduals(
        body=seen.mark,
        reading_deg=np.degrees(seen.reading_rad),
        turned_deg=np.degrees(fit.residual_px / fit.problem.station.lens.focal_px) * (-1.0, 1.0),
        kept=fit.kept,
    )


def body_labels(found: SkyCalibration) -> list[str]:
    """Return the names of passes, and of the Moon after them."""
    return [*(path.aircraft for path in found.flights), MOON_LABEL]
