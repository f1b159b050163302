"""Rows of a rolling shutter in what cameras are compared by: triangulation, cross-check and protection levels."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.encoders import HeadRates
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.geometry.aim import aim_at
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.integrity.approach_integrity import ApproachIntegrity
from groundstation.integrity.fault_geometry import FaultGeometry, StationLook
from groundstation.landing_site.fault_table import FaultTable
from groundstation.messages import PixelMeasurement, StepReport
from groundstation.rig.rig import Rig
from groundstation.simulation.standard_cases import standard_rig
from groundstation.tracking.labelled_pixel import labelled_detection
from groundstation.tracking.view_at_stamp import view_at_stamp
from tests.integrity.approach_reports import SITE, camera_of, kinematics_at

READOUT_S = 0.025
PLACE, VELOCITY = np.array([1.0, 300.0, 17.0]), np.array([0.0, -40.0, -2.0])
# heads that pass the target, one in each sense: it is above the middle of their pictures, where rows are early
RATES = {"left": np.radians([4.0, -1.0]), "right": np.radians([-4.0, 1.0])}
SIGMA_RAD, RATE_SIGMA_RAD_S = 1e-4, 0.01


def rolling() -> Rig:
    plain = standard_rig(resolution_rad=0.0, sigma_rad=SIGMA_RAD)
    return replace(plain, stations=tuple(replace(s, readout_s=READOUT_S) for s in plain.stations))


def aimed(rig: Rig, name: str, place: FloatArray) -> FloatArray:
    """Return pan and tilt (2,) that have the target in the upper part of the picture."""
    angles = aim_at(rig[name].geometry(), place)
    assert angles is not None
    return np.array([angles.pan_rad, angles.tilt_rad - 0.04])


def shown(rig: Rig, name: str, place: FloatArray, velocity: FloatArray, angles: FloatArray) -> FloatArray:
    """Return the pixel (2,) of a target at (3,) at the stamp, in the row that is exposed when it is there."""
    station, delay_s, pixel = rig[name], 0.0, np.zeros(2)
    for _ in range(4):
        seen = station.geometry().project(place + delay_s * velocity, *(angles + delay_s * RATES[name]).tolist())
        assert seen is not None
        pixel = seen.pixel
        delay_s = row_delay_s(float(pixel[1]), station.lens.image_size_px[1], READOUT_S)
    assert abs(delay_s) > 0.004
    return pixel


def view(rig: Rig, name: str, readout_s: float) -> TriangulationView:
    """Return one camera's view by a filter that knows target and heads."""
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, EstimationConfig())
    ekf.predict_to(0.0)
    for station in rig.names:
        pan, tilt = aimed(rig, station, PLACE).tolist()
        pan_rate, tilt_rate = RATES[station].tolist()
        ekf.set_angles(station, (pan, tilt), (pan_rate, tilt_rate), SIGMA_RAD)
    ekf.start_target(PLACE, VELOCITY, np.eye(6))
    angles = aimed(rig, name, PLACE)
    u, v = shown(rig, name, PLACE, VELOCITY, angles).tolist()
    found = labelled_detection(PixelMeasurement(t_s=0.0, station=name, epoch=0, u_px=u, v_px=v), 0.5)
    rates = HeadRates(*RATES[name].tolist(), RATE_SIGMA_RAD_S)
    pan, tilt = angles.tolist()
    return view_at_stamp(ekf, rig[name].geometry(), found, (pan, tilt), SIGMA_RAD, readout_s, rates)


def test_views_of_turning_heads_meet_where_the_target_is() -> None:
    """Expected: to centimetres at 300 m; by rows that all count for the stamp, metres off."""
    rig = rolling()
    found = triangulate([view(rig, name, READOUT_S) for name in rig.names])
    off = triangulate([view(rig, name, 0.0) for name in rig.names])
    assert found is not None
    assert off is not None
    assert np.abs(found.point_runway_m - PLACE).max() < 0.02
    assert np.abs(off.point_runway_m - PLACE).max() > 5.0


def test_the_rate_s_own_error_counts() -> None:
    known = view(rolling(), "left", READOUT_S)
    plain = view(rolling(), "left", 0.0)
    assert plain.angle_sigma_rad == SIGMA_RAD
    delay_s = row_delay_s(float(plain.pixel[1]), 960, READOUT_S)
    assert known.angle_sigma_rad == pytest.approx(np.hypot(SIGMA_RAD, delay_s * RATE_SIGMA_RAD_S), rel=1e-9)


def look(rig: Rig, name: str, rates: tuple[float, float] | None, t_s: float = 0.0) -> StationLook:
    known = kinematics_at(t_s)
    # the head at its own rate, from where it has the target at zero
    angles = aimed(rig, name, kinematics_at(0.0).position_runway_m) + t_s * RATES[name]
    pan, tilt = angles.tolist()
    return StationLook(
        station=name,
        t_s=t_s,
        pixel=shown(rig, name, known.position_runway_m, known.velocity_runway_m_s, angles),
        pan_rad=pan,
        tilt_rad=tilt,
        noise_px2=0.25 * np.eye(2),
        lasting_px2=np.zeros((2, 2)),
        rates_rad_s=rates,
    )


def test_protection_levels_see_no_fault_in_a_turning_head() -> None:
    """Expected: nothing is left of the pixels with the rates; pixels without."""
    rig, known = rolling(), kinematics_at(0.0)
    geometry = FaultGeometry(rig, SITE.runway, FaultTable(), span_m=2.0, constant_px=0.1)

    def residual(looks: list[StationLook]) -> FloatArray:
        rows = geometry.rows(0.0, known.position_runway_m, known.velocity_runway_m_s, looks)
        assert rows is not None
        return rows.residual

    right = [look(rig, name, (float(RATES[name][0]), float(RATES[name][1]))) for name in rig.names]
    assert np.abs(residual(right)).max() < 0.01
    assert np.abs(residual([replace(one, rates_rad_s=None) for one in right])).max() > 1.0


def test_rates_are_those_of_two_frames_in_turn() -> None:
    """Expected: one frame alone tells no rate; neither do two that are a second apart."""
    rig = rolling()
    watch = ApproachIntegrity(rig, SITE)
    for epoch, t_s in enumerate((0.0, 0.05, 1.05)):
        seen = [replace(look(rig, name, None, min(t_s, 0.05)), t_s=t_s) for name in rig.names]
        cameras = tuple(camera_of(one, epoch) for one in seen)
        watch.take(StepReport(cameras=cameras), t_s)
    for name in rig.names:
        rates = watch._looks[1][name].rates_rad_s
        assert rates == pytest.approx(tuple(RATES[name]), abs=1e-9)
        assert watch._looks[0][name].rates_rad_s is None
        assert watch._looks[2][name].rates_rad_s is None
