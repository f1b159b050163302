"""An airliner's path from its ADS-B positions, with what they leave uncertain: a curve and its likely deviations.

The positions of one pass, in the runway frame, are fitted by cubic B-splines of the receiver's time (least squares).
What the reports leave open of the spline, an error of position that lasts, and one that grows over the pass are each
a deviation of the whole curve with a sigma of one: path(t) = curve(t) + Σ qₖ deviationₖ(t), qₖ ~ N(0, 1).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from calibration.sky.adsb import AdsbReport
from calibration.stars.sky import LAPSE_C_PER_M, SEA_LEVEL_HPA, ObservingSite
from groundstation.arrays import FloatArray
from groundstation.geometry.geodesy import enu_from_geodetic, runway_axes

# one sigma: position by GNSS and where on the aircraft its antenna is; its own latency, which its transponder does not
# take out (DO-260B allows 0.6 s, and half of aircraft do better than 0.2 s); height by GNSS; the air's temperature
HORIZONTAL_M, OWN_LATENCY_S, HEIGHT_M = 30.0, 0.3, 40.0
AIR_SHARE_MEASURED, AIR_SHARE_STANDARD = 0.015, 0.03
# over half a pass
DRIFT_M = 10.0
# of one report: a unit of CPR, the step of a height, some 50 ms of its stamp
REPORT_M = 15.0
_KNOT_S = 30.0
_LEAST_REPORTS = 8
_MARGIN_S = 15.0
_LONGEST_GAP_S = 12.0
_OUTLIER = 4.0
# hypsometric exponent of a lapse of 6.5 K/km
_EXPONENT = 0.190263
_KELVIN = 273.15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightPath:
    """One pass.

    Attributes
    ----------
    aircraft : ICAO address.
    middle_s : the receiver's time that curves count from.
    span_s : (first, last) report, from ``middle_s``.
    knots, coefficients : of the curve, (k,) and (c, 3), runway frame, m.
    deviations : (c, 3, m), coefficients of the deviations of sigma one.
    report_m : what reports scatter by, one sigma. reports : how many.
    """

    aircraft: str
    middle_s: float
    span_s: tuple[float, float]
    knots: FloatArray
    coefficients: FloatArray
    deviations: FloatArray
    report_m: float
    reports: int

    @property
    def count(self) -> int:
        """How many deviations it has."""
        return self.deviations.shape[2]

    def at(self, t_s: FloatArray, derivative: int = 0) -> tuple[FloatArray, FloatArray]:
        """Return the curve (n, 3) and its deviations (n, 3, m), or their derivatives, at times (n,) from the middle."""
        basis = _basis(self.knots, t_s, derivative)
        return basis @ self.coefficients, np.einsum("nc,cik->nik", basis, self.deviations)


def _basis(knots: FloatArray, t_s: FloatArray, derivative: int = 0) -> FloatArray:
    """Return the splines (n, c) at times (n,), continued beyond the knots."""
    count = len(knots) - 4
    spline = BSpline(knots, np.eye(count), 3, extrapolate=True)
    return np.asarray((spline.derivative(derivative) if derivative else spline)(t_s))


def runway_positions(reports: Sequence[AdsbReport], site: ObservingSite) -> FloatArray:
    """Return the positions (n, 3), runway frame, m, of reports; pressure altitudes by the site's air."""
    height = np.array([r.height_m if r.geometric else geometric_height(r.height_m, site) for r in reports])
    lat, lon = np.array([r.lat_deg for r in reports]), np.array([r.lon_deg for r in reports])
    east_north_up = enu_from_geodetic(lat, lon, height, (site.lat_deg, site.lon_deg, site.height_m))
    return np.asarray(east_north_up @ runway_axes(site.y_axis_azimuth_deg).T)


def geometric_height(pressure_altitude_m: float, site: ObservingSite) -> float:
    """Return the height, m, at which the air over a site has the pressure of a pressure altitude."""
    ratio = 1.0 - LAPSE_C_PER_M * pressure_altitude_m / (15.0 + _KELVIN)
    at_aircraft = SEA_LEVEL_HPA * max(ratio, 0.05) ** (1.0 / _EXPONENT)
    kelvin = site.temperature + _KELVIN
    return site.height_m + kelvin / LAPSE_C_PER_M * (1.0 - (at_aircraft / site.pressure) ** _EXPONENT)


def fit_path(reports: Sequence[AdsbReport], from_s: float, to_s: float, site: ObservingSite) -> FlightPath | str:
    """Return the path between two times of the receiver, or why the reports tell too little of it."""
    used = [r for r in reports if from_s - _MARGIN_S <= r.t_s <= to_s + _MARGIN_S]
    geometric = sum(r.geometric for r in used) * 2 > len(used)
    used = [r for r in used if r.geometric == geometric]
    if len(used) < _LEAST_REPORTS:
        return f"{len(used)} positions around its pictures, at least {_LEAST_REPORTS} are needed"
    t = np.array([r.t_s for r in used])
    if t[0] > from_s or t[-1] < to_s or float(np.diff(t).max()) > _LONGEST_GAP_S:
        return f"positions with a gap of more than {_LONGEST_GAP_S:g} s around its pictures"
    middle = 0.5 * (from_s + to_s)
    t = t - middle
    place = runway_positions(used, site)
    pieces = max(1, min(int((t[-1] - t[0]) / _KNOT_S), len(t) // 4 - 3))
    inner = np.linspace(t[0], t[-1], pieces + 1)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    basis = _basis(knots, t)
    kept = np.ones(len(t), dtype=np.bool_)
    coefficients, off = np.zeros((basis.shape[1], 3)), np.zeros(len(t))
    for _ in range(3):
        coefficients = np.asarray(np.linalg.lstsq(basis[kept], place[kept], rcond=None)[0], dtype=np.float64)
        off = np.linalg.norm(place - basis @ coefficients, axis=1)
        kept = off <= _OUTLIER * max(float(np.median(off)), REPORT_M)
    free = max(int(kept.sum()) - basis.shape[1], 1)
    scatter = float(np.sqrt(np.sum(off[kept] ** 2) / (3.0 * free)))
    report_m = max(REPORT_M, scatter)
    return FlightPath(
        aircraft=used[0].aircraft,
        middle_s=middle,
        span_s=(float(t[0]), float(t[-1])),
        knots=knots,
        coefficients=coefficients,
        deviations=_deviations(knots, basis[kept], coefficients, report_m, _height_sigma(used, site)),
        report_m=report_m,
        reports=int(kept.sum()),
    )


def _height_sigma(reports: Sequence[AdsbReport], site: ObservingSite) -> float:
    if reports[0].geometric:
        return HEIGHT_M
    measured = site.pressure_hpa is not None and site.air_c is not None
    share = AIR_SHARE_MEASURED if measured else AIR_SHARE_STANDARD
    above = float(np.mean([r.height_m for r in reports])) - site.height_m
    return math.hypot(HEIGHT_M, share * above)


def _deviations(
    knots: FloatArray, basis: FloatArray, coefficients: FloatArray, report_m: float, height_m: float
) -> FloatArray:
    """Return the deviations (c, 3, m): of the reports' scatter, of a lasting error, of one that grows."""
    count = basis.shape[1]
    known = basis.T @ basis / report_m**2
    # what no report tells is a curve that may be anywhere within a kilometre
    root = np.linalg.cholesky(np.linalg.inv(known + np.eye(count) * 1e-6))
    columns = [root[:, k, None] * axis for axis in np.eye(3) for k in range(count)]
    # a straight line's coefficients are its values at the mean of three knots (Greville)
    sites = np.array([knots[k + 1 : k + 4].mean() for k in range(count)])
    line = (sites - 0.5 * (knots[0] + knots[-1])) / max(0.5 * np.ptp(knots), 1e-9)
    for axis, sigma in zip(np.eye(3), (HORIZONTAL_M, HORIZONTAL_M, height_m), strict=True):
        columns.append(sigma * np.ones((count, 1)) * axis)
        columns.append(DRIFT_M * line[:, None] * axis)
    # its own latency moves an aircraft along its way, wherever that leads
    velocity = _basis(knots, sites, 1) @ coefficients
    columns.append(np.asarray(OWN_LATENCY_S * np.linalg.solve(_basis(knots, sites), velocity), dtype=np.float64))
    return np.stack(columns, axis=2)
