"""A log's positions in the session's frame, at times of the session's DGPS clock."""

import numpy as np

from groundstation.errors import LogError
from groundstation.geometry.geodesy import enu_from_geodetic, runway_axes
from groundstation.messages import DgpsFix
from groundstation.session.logs.gps_time import TimeScale, gps_from_civil, utc_day
from groundstation.session.logs.read import MAX_EXTENT_M, GnssLog

_MIN_SIGMA_M = 1e-4


def midnight_before(log: GnssLog) -> float:
    """Return the GPS time of 0 h UTC of the day of a log's first position."""
    return gps_from_civil(utc_day(float(log.gps_s[0])), 0.0, TimeScale.UTC)


def place_log(
    log: GnssLog, origin_deg_m: tuple[float, float, float], y_axis_azimuth_deg: float, epoch_gps_s: float
) -> list[DgpsFix]:
    """Return the log's fixes in a frame whose origin and direction of +y (clockwise from true north) are given.

    Their times are seconds since ``epoch_gps_s``. Raises `LogError` where the log is nowhere near the origin.
    """
    enu = enu_from_geodetic(log.lat_deg, log.lon_deg, log.height_m, origin_deg_m)
    nearest = float(np.linalg.norm(enu, axis=1).min())
    if nearest > MAX_EXTENT_M:
        got = f"positions {nearest / 1e3:.0f} km and more from the origin"
        lat, lon, height = origin_deg_m
        exchanged = enu_from_geodetic(log.lat_deg, log.lon_deg, log.height_m, (lon, lat, height))
        if float(np.linalg.norm(exchanged, axis=1).min()) <= MAX_EXTENT_M:
            got += ", near the one with latitude and longitude exchanged"
        raise LogError(log.name, got=got, wanted=f"some within {MAX_EXTENT_M / 1e3:.0f} km, or another origin")
    runway_from_enu = runway_axes(y_axis_azimuth_deg)
    position = enu @ runway_from_enu.T
    covariance = np.zeros((len(enu), 3, 3))
    covariance[:, [0, 1, 2], [0, 1, 2]] = log.sigma_enu_m**2
    covariance[:, 0, 1] = covariance[:, 1, 0] = log.covariance_en_m2
    variance = np.einsum("ij,njk,ik->ni", runway_from_enu, covariance, runway_from_enu)
    sigma = np.sqrt(np.maximum(variance, _MIN_SIGMA_M**2))
    return [
        DgpsFix(t_s=float(t), position_runway_m=p, sigma_m=s_m, status=str(q))
        for t, p, s_m, q in zip(log.gps_s - epoch_gps_s, position, sigma, log.quality, strict=True)
    ]
