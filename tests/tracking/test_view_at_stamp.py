"""Rows of a rolling shutter in what cameras are compared by: triangulation, cross-check and protection levels."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.encoders import EncoderFeed
from groundstation.estimation.state_model import PTU_ACCELERATION_PSD_RAD2_S3
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.geometry.aim import aim_at
from groundstation.geometry.head_rates import HeadRates
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.integrity.approach_integrity import ApproachIntegrity
from groundstation.integrity.fault_geometry import FaultGeometry, StationLook
from groundstation.landing_site.fault_table import FaultTable
from groundstation.messages import PixelMeasurement, PtuSample, StepReport
from groundstation.rig.rig import Rig
from groundstation.simulation.standard_cases import standard_rig
from groundstation.tracking.config import Config
from groundstation.tracking.labelled_pixel import labelled_detection
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.view_at_stamp import view_at_stamp
from tests.integrity.approach_reports import SITE, camera_of, kinematics_at
from tests.stereo_rig import aim, flight_events, glide, make_rig

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


def view(rig: Rig, name: str, readout_s: float, velocity_sigma_m_s: float = 1.0) -> TriangulationView:
    """Return one camera's view by a filter that knows target and heads."""
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, EstimationConfig())
    ekf.predict_to(0.0)
    for station in rig.names:
        pan, tilt = aimed(rig, station, PLACE).tolist()
        pan_rate, tilt_rate = RATES[station].tolist()
        ekf.set_angles(station, (pan, tilt), (pan_rate, tilt_rate), SIGMA_RAD, RATE_SIGMA_RAD_S)
    ekf.start_target(PLACE, VELOCITY, np.diag([1.0] * 3 + [velocity_sigma_m_s**2] * 3))
    angles = aimed(rig, name, PLACE)
    u, v = shown(rig, name, PLACE, VELOCITY, angles).tolist()
    found = labelled_detection(PixelMeasurement(t_s=0.0, station=name, epoch=0, u_px=u, v_px=v), 0.5)
    pan, tilt = angles.tolist()
    return view_at_stamp(ekf, rig[name].geometry(), found, (pan, tilt), SIGMA_RAD, readout_s)


def test_views_of_turning_heads_meet_where_the_target_is() -> None:
    """Expected: to centimetres at 300 m; by rows that all count for the stamp, metres off."""
    rig = rolling()
    found = triangulate([view(rig, name, READOUT_S) for name in rig.names])
    off = triangulate([view(rig, name, 0.0) for name in rig.names])
    assert found is not None
    assert off is not None
    assert np.abs(found.point_runway_m - PLACE).max() < 0.02
    assert np.abs(off.point_runway_m - PLACE).max() > 5.0


@pytest.mark.parametrize("velocity_sigma_m_s", [0.0, 4.0, 15.0])
def test_what_the_filter_does_not_know_of_the_motion_counts(velocity_sigma_m_s: float) -> None:
    """Expected: the delay times what velocity and rates are uncertain by, as the pixel moves with place and angles."""
    rig = rolling()
    known = view(rig, "left", READOUT_S, velocity_sigma_m_s)
    plain = view(rig, "left", 0.0, velocity_sigma_m_s)
    delay_s = row_delay_s(float(plain.pixel[1]), 960, READOUT_S)
    pan, tilt = aimed(rig, "left", PLACE) + delay_s * RATES["left"]
    seen = rig["left"].geometry().project(PLACE + delay_s * VELOCITY, float(pan), float(tilt))
    assert seen is not None
    sigmas = delay_s * np.array([velocity_sigma_m_s] * 3 + [RATE_SIGMA_RAD_S] * 2)
    moved_px = seen.jacobian * sigmas
    assert known.covariance_px2 - plain.covariance_px2 == pytest.approx(moved_px @ moved_px.T, rel=1e-6, abs=1e-9)
    assert known.angle_sigma_rad == plain.angle_sigma_rad == SIGMA_RAD


def test_chi2_of_views_allows_for_a_velocity_that_is_off() -> None:
    """Expected: the residual of two views that were moved back by drawn velocities is as large as they state."""
    rig, rng, sigma_m_s, n = rolling(), np.random.default_rng(1), 15.0, 200
    geometry, chi2 = {s.name: s.geometry() for s in rig.stations}, []
    for _ in range(n):
        guess = VELOCITY + sigma_m_s * rng.normal(size=3)
        ekf = StationEkf(geometry, rig.names, EstimationConfig())
        ekf.predict_to(0.0)
        angles = {name: aimed(rig, name, PLACE) for name in rig.names}
        for name in rig.names:
            pan, tilt = angles[name].tolist()
            told = RATES[name] + RATE_SIGMA_RAD_S * rng.normal(size=2)
            ekf.set_angles(name, (pan, tilt), (float(told[0]), float(told[1])), SIGMA_RAD, RATE_SIGMA_RAD_S)
        ekf.start_target(PLACE, guess, np.diag([1e-6] * 3 + [sigma_m_s**2] * 3))
        for name in rig.names:
            true = shown(rig, name, PLACE, VELOCITY, angles[name])
            u, v = (true + 0.5 * rng.normal(size=2)).tolist()
            found = labelled_detection(PixelMeasurement(t_s=0.0, station=name, epoch=0, u_px=u, v_px=v), 0.5)
            pan, tilt = angles[name].tolist()
            moved = view_at_stamp(ekf, geometry[name], found, (pan, tilt), 0.0, READOUT_S)
            at = geometry[name].project(PLACE, pan, tilt)
            assert at is not None
            off = moved.pixel - at.pixel
            chi2.append(float(off @ np.linalg.solve(moved.covariance_px2, off)))
    # two cameras see the same wrong velocity: only the sum of one is independent from draw to draw
    for k in range(2):
        low, high = scipy.stats.chi2.ppf([0.001, 0.999], 2 * n)
        assert low < sum(chi2[k::2]) < high


def look(rig: Rig, name: str, rates: HeadRates | None, t_s: float = 0.0) -> StationLook:
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
        rates=rates,
    )


def test_protection_levels_see_no_fault_in_a_turning_head() -> None:
    """Expected: nothing is left of the pixels with the rates; pixels without."""
    rig, known = rolling(), kinematics_at(0.0)
    geometry = FaultGeometry(rig, SITE.runway, FaultTable(), span_m=2.0, constant_px=0.1)

    def residual(looks: list[StationLook]) -> FloatArray:
        rows = geometry.rows(0.0, known.position_runway_m, known.velocity_runway_m_s, looks)
        assert rows is not None
        return rows.residual

    right = [look(rig, name, HeadRates(*RATES[name].tolist(), 0.0)) for name in rig.names]
    assert np.abs(residual(right)).max() < 0.01
    assert np.abs(residual([replace(one, rates=None) for one in right])).max() > 1.0


def test_rates_are_those_of_the_report() -> None:
    """Expected: the filter's of each frame, with their sigma, of the first frame too; none where it has none."""
    rig = rolling()
    watch = ApproachIntegrity(rig, SITE)
    for epoch, t_s in enumerate((0.0, 0.05, 1.05)):
        known = {n: None if epoch == 1 else HeadRates(*RATES[n].tolist(), 0.01, (1e-6, 2e-6)) for n in rig.names}
        seen = [replace(look(rig, name, known[name], min(t_s, 0.05)), t_s=t_s) for name in rig.names]
        watch.take(StepReport(cameras=tuple(camera_of(one, epoch) for one in seen)), t_s)
        assert {name: watch._looks[epoch][name].rates for name in rig.names} == known


def test_the_pipeline_reports_the_rates_of_heads() -> None:
    """Expected: those at which the heads turn, within their sigma; known better than a head may turn."""
    rig, lag_s, step_s = make_rig(), 0.2, 0.001
    pipeline, off = Pipeline(rig, Config()), []
    for event in flight_events(rig, glide, np.random.default_rng(0), duration_s=4.0, pan_lag_s=lag_s):
        for report in pipeline.step(event).cameras:
            if report.t_s < 1.0:
                continue
            assert report.rates is not None
            told, geometry = report.rates, rig[report.station].geometry()
            after, before = (np.array(aim(geometry, glide(report.t_s - lag_s + d))) for d in (step_s, -step_s))
            true = (after - before) / (2.0 * step_s)
            assert 0.0 < told.sigma_rad_s < math.radians(2.0)
            off.append(np.abs([told.pan_rad_s, told.tilt_rad_s] - true).max() / told.sigma_rad_s)
    assert len(off) > 40
    assert max(off) < 5.0


@pytest.mark.parametrize("rate_hz", [20, 60, 200])
@pytest.mark.parametrize("readout_s", [READOUT_S, -READOUT_S])
def test_residuals_are_as_large_as_the_readings_noise_makes_them(rate_hz: int, readout_s: float) -> None:
    """Expected: χ² of four degrees of freedom, of heads that accelerate as the filter assumes, by its rates of them.

    A row before the stamp and one after it: the errors of angle and rate have one sign, and add up in one of them.
    """
    n, rng, sigma_rad, sigma_px = 200, np.random.default_rng(3), math.radians(0.01), 0.05
    plain = standard_rig(resolution_rad=0.0, sigma_rad=sigma_rad)
    rig = replace(plain, stations=tuple(replace(s, readout_s=readout_s) for s in plain.stations))
    geometry = FaultGeometry(rig, SITE.runway, FaultTable(), span_m=2.0, constant_px=0.1)
    stations, known, chi2 = {s.name: s.geometry() for s in rig.stations}, kinematics_at(0.0), 0.0
    for _ in range(n):
        ekf = StationEkf(stations, rig.names, EstimationConfig())
        encoders, looks = EncoderFeed(ekf, {s.name: s for s in rig.stations}, EstimationConfig()), []
        # angles and rates at each reading, such that at the last one the target is where it should be
        path = {name: drawn_path(rig, name, rate_hz, rng) for name in rig.names}
        read = np.zeros((2, 2))
        for k in range(_READINGS):
            t_s = (k + 1 - _READINGS) / rate_hz
            ekf.predict_to(t_s)
            for row, name in enumerate(rig.names):
                read[row] = path[name][k, :2] + sigma_rad * rng.normal(size=2)
                pan, tilt = read[row].tolist()
                assert encoders.read(PtuSample(t_s=t_s, station=name, pan_rad=pan, tilt_rad=tilt)) is None
        for row, name in enumerate(rig.names):
            angles, turned, delay_s, pixel = path[name][-1, :2], path[name][-1, 2:], 0.0, np.zeros(2)
            for _ in range(5):
                place = known.position_runway_m + delay_s * known.velocity_runway_m_s
                seen = stations[name].project(place, *(angles + delay_s * turned).tolist())
                assert seen is not None
                pixel = seen.pixel
                delay_s = row_delay_s(float(pixel[1]), stations[name].image_size_px[1], readout_s)
            looks.append(
                StationLook(
                    station=name,
                    t_s=0.0,
                    pixel=pixel + sigma_px * rng.normal(size=2),
                    pan_rad=float(read[row, 0]),
                    tilt_rad=float(read[row, 1]),
                    noise_px2=sigma_px**2 * np.eye(2),
                    lasting_px2=np.zeros((2, 2)),
                    rates=encoders.rates(name),
                )
            )
        rows = geometry.rows(0.0, known.position_runway_m, known.velocity_runway_m_s, looks)
        assert rows is not None
        chi2 += float(rows.residual @ rows.weight @ rows.residual)
    low, high = scipy.stats.chi2.ppf([0.001, 0.999], 4 * n)
    assert low < chi2 < high


_READINGS = 15


def drawn_path(rig: Rig, name: str, rate_hz: int, rng: np.random.Generator) -> FloatArray:
    """Return angles and rates (n, 4) of a head at each reading, accelerated by the filter's white noise."""
    dt, q = 1.0 / rate_hz, PTU_ACCELERATION_PSD_RAD2_S3
    root = np.linalg.cholesky(q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]]))
    path = np.zeros((_READINGS, 4))
    path[0, 2:] = RATES[name]
    for k in range(1, _READINGS):
        step = root @ rng.normal(size=(2, 2))
        path[k, :2] = path[k - 1, :2] + dt * path[k - 1, 2:] + step[0]
        path[k, 2:] = path[k - 1, 2:] + step[1]
    path[:, :2] += aimed(rig, name, kinematics_at(0.0).position_runway_m) - path[-1, :2]
    return path
