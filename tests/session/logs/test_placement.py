"""A log's level covariance in the session's frame: sigmas along and across the runway, whatever its azimuth."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.geometry.geodesy import ecef_from_geodetic, enu_axes
from groundstation.live.reference_fixes import ReferenceClock, ReferenceConverter
from groundstation.session.folder import GeoOrigin
from groundstation.session.logs.fixes import FixQuality, LogFix
from groundstation.session.logs.gps_time import TimeScale, gps_from_civil
from groundstation.session.logs.placement import place_log
from groundstation.session.logs.read import GnssLog, read_log

DATA = Path(__file__).parent / "data"


def signed_root(value: float) -> float:
    """As RTKLIB writes a covariance."""
    return math.copysign(math.sqrt(abs(value)), value)


def placed_sigmas(log: GnssLog, azimuth_deg: float) -> np.ndarray:
    """Return the sigmas (3,) of a log's first fix in the frame whose +y points to this azimuth."""
    origin = (float(log.lat_deg[0]), float(log.lon_deg[0]), float(log.height_m[0]))
    (fix, *_) = place_log(log, origin, azimuth_deg, 0.0)
    return np.asarray(fix.sigma_m)


def one_fix(folder: Path, name: str, east_m: float, north_m: float, covariance_m2: float) -> GnssLog:
    """Return a log of one fix with these sigmas and covariance, written as RTKLIB does, east-north-up or ECEF."""
    lat, lon, height = 35.681, 139.7605, 75.0
    enu = np.array([[east_m**2, covariance_m2, 0.0], [covariance_m2, north_m**2, 0.0], [0.0, 0.0, 0.04**2]])
    if name == "ecef":
        axes = enu_axes((lat, lon, height))
        x, y, z = ecef_from_geodetic(np.array(lat), np.array(lon), np.array(height))
        C = axes.T @ enu @ axes
        cells = [x, y, z, 1, 9, *(signed_root(C[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)))]
        head = "x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio"
    else:
        cells = [lat, lon, height, 1, 9, north_m, east_m, 0.04, signed_root(covariance_m2), 0.0, 0.0]
        head = "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio"
    numbers = [f"{c}" if isinstance(c, int) else f"{float(c):.12f}" for c in cells]
    row = " ".join(["2025/05/08 12:00:10.200", *numbers, "0", "9"])
    path = folder / f"{name}.pos"
    path.write_text(f"%  GPST {head}\n{row}\n")
    return read_log(path)


@pytest.mark.parametrize("name", ["geodetic", "ecef"])
@pytest.mark.parametrize("azimuth_deg", [0.0, 30.0, 45.0, 135.0, 200.0, 300.0])
@pytest.mark.parametrize("correlation", [0.9, -0.6])
def test_east_and_north_that_err_together_are_turned_together(
    tmp_path: Path, name: str, azimuth_deg: float, correlation: float
) -> None:
    """Expected: sigmas along and across the runway of the whole level covariance, whose ellipse may lie aslant."""
    east, north = 0.05, 0.02
    shared = correlation * east * north
    log = one_fix(tmp_path, name, east, north, shared)
    assert log.covariance_en_m2[0] == pytest.approx(shared, rel=1e-5)
    s, c = np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))
    # right of the runway's direction is (c, -s) of east and north, along it (s, c)
    across = (c * east) ** 2 + (s * north) ** 2 - 2.0 * c * s * shared
    along = (s * east) ** 2 + (c * north) ** 2 + 2.0 * c * s * shared
    assert placed_sigmas(log, azimuth_deg) == pytest.approx([np.sqrt(across), np.sqrt(along), 0.04], rel=1e-5)


def test_a_fix_that_errs_along_one_line_errs_along_the_runway_only() -> None:
    """Expected: with the line along the runway nothing is left across it but the least sigma; the other way round."""
    direction = np.radians(30.0)
    east, north = 0.3 * np.sin(direction), 0.3 * np.cos(direction)
    log = replace(
        read_log(DATA / "calendar.pos"),
        gps_s=np.zeros(1),
        lat_deg=np.array([35.68]),
        lon_deg=np.array([139.76]),
        height_m=np.array([60.0]),
        sigma_enu_m=np.array([[east, north, 0.04]]),
        covariance_en_m2=np.array([east * north]),
        quality=(FixQuality.FIX,),
    )
    assert placed_sigmas(log, 30.0) == pytest.approx([1e-4, 0.3, 0.04])
    assert placed_sigmas(log, 120.0) == pytest.approx([0.3, 1e-4, 0.04])


def test_a_live_fix_is_turned_as_a_log_is(tmp_path: Path) -> None:
    """Expected: covariance and all, at the time of the session's clock."""
    log = one_fix(tmp_path, "geodetic", 0.05, 0.02, 0.0009)
    lat, lon, height = (float(v[0]) for v in (log.lat_deg, log.lon_deg, log.height_m))
    fix = LogFix(
        day=20000,
        second=43210.0,
        scale=TimeScale.GPS,
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        quality=FixQuality.FIX,
        sigma_enu_m=(0.05, 0.02, 0.04),
        covariance_en_m2=0.0009,
    )
    clock = ReferenceClock(gps_from_civil(20000, 43200.0, TimeScale.GPS), 0.0)
    origin = GeoOrigin(lat_deg=lat, lon_deg=lon, height_m=height, y_axis_azimuth_deg=45.0)
    placed = ReferenceConverter(origin, clock, None, later_s=0.1).convert(fix, 10.5)
    assert placed.nose is not None
    assert placed.nose.t_s == pytest.approx(9.9)
    assert placed.nose.sigma_m == pytest.approx(placed_sigmas(log, 45.0), rel=1e-6)


def test_a_covariance_that_its_sigmas_do_not_allow_is_none(tmp_path: Path) -> None:
    """Expected: more than fully correlated cannot be: the sigmas stay, as if nothing tied them."""
    assert one_fix(tmp_path, "geodetic", 0.05, 0.02, 0.05 * 0.02 * 0.999).covariance_en_m2[0] > 0.0
    log = one_fix(tmp_path, "geodetic", 0.05, 0.02, -0.05 * 0.02 * 1.01)
    assert log.covariance_en_m2[0] == 0.0
    assert log.sigma_enu_m[0] == pytest.approx([0.05, 0.02, 0.04])
