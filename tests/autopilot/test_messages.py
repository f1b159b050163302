"""The fields of each message: frames, heights, times, covariances, and what is not known."""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray
from groundstation.autopilot.gps_input import gps_week
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.settings import AutopilotMode, AutopilotSettings
from groundstation.autopilot.status_text import status_texts
from groundstation.autopilot.vehicle_attitude import VehicleAttitude
from groundstation.autopilot.vehicle_delay import asked_parameters
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.session.folder import GeoOrigin
from tests.autopilot.flights import (
    CLOCK,
    COVARIANCE,
    ORIGIN,
    SEPARATION_M,
    StraightFlight,
    answer,
    listed,
    one_state,
    stream_of,
    symmetric,
    values,
)

# y points 30° east of north: the unit vectors of x and y as north and east
_AZIMUTH = math.radians(ORIGIN.y_axis_azimuth_deg)
_X_NE = np.array([-math.sin(_AZIMUTH), math.cos(_AZIMUTH)])
_Y_NE = np.array([math.cos(_AZIMUTH), math.sin(_AZIMUTH)])
_YAW = math.atan2(-_Y_NE[1], -_Y_NE[0])


def _ned(runway: FloatArray) -> FloatArray:
    north, east = runway[0] * _X_NE + runway[1] * _Y_NE
    return np.array([north, east, -runway[2]])


def test_gps_input_is_the_place_on_earth_with_velocity_north_east_down() -> None:
    flight = StraightFlight()
    message = one_state(stream_of(flight, AutopilotMode.GPS_INPUT), flight, 2.0, VehicleState())
    # expected: the state of 0.2 s ago, ArduPilot's lag of a MAVLink receiver; by another library
    north, east, down = _ned(flight.position(1.8))
    lat, lon, height = pymap3d.ned2geodetic(north, east, down, ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.height_m)
    assert message.fields["lat"] == pytest.approx(lat * 1e7, abs=1)
    assert message.fields["lon"] == pytest.approx(lon * 1e7, abs=1)
    assert message.fields["alt"] == pytest.approx(height - SEPARATION_M, abs=1e-3)
    np.testing.assert_allclose(values(message, "vn", "ve", "vd"), _ned(flight.velocity), atol=1e-9)
    assert message.fields["ignore_flags"] == 0
    assert message.fields["fix_type"] == 3
    assert message.fields["yaw"] == 0
    # over the horizontal directions, and all directions, of 0.03 and 0.4 m, of 0.05, 0.2 and 0.05 m/s
    assert message.fields["horiz_accuracy"] == pytest.approx(math.sqrt((0.03**2 + 0.4**2) / 2.0))
    assert message.fields["vert_accuracy"] == pytest.approx(0.04)
    assert message.fields["speed_accuracy"] == pytest.approx(math.sqrt((0.05**2 + 0.2**2 + 0.05**2) / 3.0))


def test_gps_time_of_known_moments() -> None:
    # 2017-01-01 00:00:00 UTC is GPS 2017-01-01 00:00:18: week 1930, its first day; 1980-01-06 is week 0
    assert gps_week(1_483_228_800.0) == (1930, 18_000)
    assert gps_week(315_964_800.5) == (0, 500)


def test_the_stamp_of_gps_input_is_the_time_of_the_state() -> None:
    flight = StraightFlight()
    message = one_state(stream_of(flight, AutopilotMode.GPS_INPUT), flight, 2.0, VehicleState())
    assert (message.fields["time_week"], message.fields["time_week_ms"]) == gps_week(CLOCK.unix_s + 1.8)


def test_a_lag_that_the_vehicle_states_is_the_one_that_counts() -> None:
    flight = StraightFlight()
    for name, told, lag_s in (
        ("GPS1_DELAY_MS", 120.0, 0.12),
        ("GPS1_DELAY_MS", 0.0, 0.2),
        ("GPS_DELAY_MS", 50.0, 0.05),
    ):
        vehicle = VehicleState(parameters={name: told})
        message = one_state(stream_of(flight, AutopilotMode.GPS_INPUT), flight, 2.0, vehicle)
        assert message.fields["time_week_ms"] == gps_week(CLOCK.unix_s + 2.0 - lag_s)[1]


def test_the_lag_is_that_of_the_receiver_that_the_stream_stands_for() -> None:
    """Expected: of the second receiver its own delay, which the vehicle is asked for, not that of the first."""
    flight = StraightFlight()
    first = {"GPS1_DELAY_MS": 250.0, "GPS_DELAY_MS": 250.0}
    for name in ("GPS2_DELAY_MS", "GPS_DELAY_MS2"):
        stream = stream_of(flight, AutopilotMode.GPS_INPUT, gps_id=1)
        message = one_state(stream, flight, 2.0, VehicleState(parameters=first | {name: 50.0}))
        assert message.fields["time_week_ms"] == gps_week(CLOCK.unix_s + 1.95)[1]
        settings = AutopilotSettings(url="udpout:127.0.0.1:1", mode=AutopilotMode.GPS_INPUT, gps_id=1)
        assert name in asked_parameters(settings, VehicleState())
        assert not first.keys() & set(asked_parameters(settings, VehicleState()))


def test_global_position_sensor() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.GLOBAL_POSITION)
    message = one_state(stream, flight, 2.0, VehicleState(system=7))
    assert message.fields["target_system"] == 7
    assert message.fields["source"] == 2
    assert np.diff(values(message, "alt", "alt_ellipsoid")) == pytest.approx(SEPARATION_M)
    assert message.fields["time_usec"] == 1_002_000_000
    assert message.fields["processing_time"] == 0
    eph_m = math.sqrt((0.03**2 + 0.4**2) / 2.0)
    assert (message.fields["eph"], message.fields["epv"]) == (pytest.approx(eph_m), pytest.approx(0.04))


def test_vision_is_about_the_global_origin_with_angles_of_no_knowledge() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION)
    message = one_state(stream, flight, 2.0, VehicleState())
    np.testing.assert_allclose(values(message, "x", "y", "z"), _ned(flight.position(2.0)), atol=1e-9)
    covariance = symmetric(listed(message, "covariance"))
    rotation = np.array([[*_X_NE, 0.0], [*_Y_NE, 0.0], [0.0, 0.0, -1.0]]).T
    np.testing.assert_allclose(covariance[:3, :3], rotation @ COVARIANCE[:3, :3] @ rotation.T, atol=1e-12)
    assert np.all(np.diag(covariance)[3:] > 3.0)
    assert (message.fields["roll"], message.fields["pitch"], message.fields["yaw"]) == (0.0, 0.0, 0.0)


def test_vision_speed_goes_with_the_position() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION)
    stream.note(answer(flight, 2.0))
    names = [m.name for m in stream.messages(2.0, VehicleState())]
    assert names[-2:] == ["VISION_POSITION_ESTIMATE", "VISION_SPEED_ESTIMATE"]


def test_a_vehicle_with_an_origin_of_its_own_gets_positions_about_that() -> None:
    flight = StraightFlight()
    other = (47.301, 8.502, 410.0)
    stream = stream_of(flight, AutopilotMode.VISION)
    message = one_state(stream, flight, 2.0, VehicleState(system=1, global_origin=other))
    north, east, down = _ned(flight.position(2.0))
    lat, lon, height = pymap3d.ned2geodetic(north, east, down, ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.height_m)
    wanted = pymap3d.geodetic2ned(lat, lon, height, other[0], other[1], other[2] + SEPARATION_M)
    np.testing.assert_allclose(values(message, "x", "y", "z"), wanted, atol=1e-6)


def test_odometry_without_an_attitude_of_the_vehicle_invents_none() -> None:
    flight = StraightFlight()
    message = one_state(stream_of(flight, AutopilotMode.ODOMETRY), flight, 2.0, VehicleState())
    assert (message.fields["frame_id"], message.fields["child_frame_id"]) == (20, 12)
    assert np.all(np.isnan(listed(message, "q")))
    assert np.all(np.isnan(values(message, "vx", "vy", "vz")))
    assert 1 <= values(message, "quality")[0] <= 100


def test_odometry_has_the_velocity_in_the_body_of_the_vehicles_own_attitude() -> None:
    flight = StraightFlight()
    # 15° of crab to the right of the track, 5° nose up
    attitude = VehicleAttitude.from_euler(2.0, 0.0, math.radians(5.0), _YAW + math.radians(15.0), np.zeros(3))
    message = one_state(stream_of(flight, AutopilotMode.ODOMETRY), flight, 2.0, VehicleState(attitude=attitude))
    assert attitude is not None
    body = values(message, "vx", "vy", "vz")
    np.testing.assert_allclose(attitude.ned_from_body @ body, _ned(flight.velocity), atol=1e-9)
    # the wind comes from the right: the track is left of the nose
    assert body[1] < -6.0


def test_a_line_for_the_pilot_is_cut_into_parts_of_fifty_bytes() -> None:
    assert [m.fields["text"] for m in status_texts(4, "WAVE-OFF", 9)] == [b"WAVE-OFF"]
    assert status_texts(4, "short", 9)[0].fields["id"] == 0
    for length in (50, 51, 99, 100, 101, 150, 260):
        parts = [m.fields["text"] for m in status_texts(4, "x" * length, 9)]
        lengths = [len(part) for part in parts if isinstance(part, bytes)]
        assert len(lengths) == len(parts)
        assert max(lengths) <= 50
        assert sum(lengths) == min(length, 200)
        # a receiver joins parts until one that is not full
        assert length <= 50 or lengths[-1] < 50
    assert status_texts(4, "0.3° off", 1)[0].fields["text"] == b"0.3? off"


@settings(max_examples=50)
@given(
    st.floats(-80.0, 80.0),
    st.floats(-180.0, 180.0),
    st.floats(-400.0, 4000.0),
    st.floats(-180.0, 180.0),
    st.tuples(*[st.floats(-2000.0, 2000.0)] * 3),
)
def test_geodetic_positions_agree_with_another_library(
    lat: float, lon: float, height: float, azimuth: float, runway: tuple[float, float, float]
) -> None:
    frame = LocalFrame(GeoOrigin(lat_deg=lat, lon_deg=lon, height_m=height, y_axis_azimuth_deg=azimuth), -20.0)
    ned = frame.ned_from_runway @ np.array(runway)
    found = frame.geodetic(ned)
    wanted = pymap3d.ned2geodetic(*ned, lat, lon, height)
    back = pymap3d.geodetic2ned(found.lat_deg, found.lon_deg, found.height_ellipsoid_m, lat, lon, height)
    np.testing.assert_allclose(back, ned, atol=1e-4)
    assert found.height_ellipsoid_m == pytest.approx(wanted[2], abs=1e-4)
    assert found.height_amsl_m == pytest.approx(found.height_ellipsoid_m + 20.0)
    np.testing.assert_allclose(frame.ned_from_runway @ frame.ned_from_runway.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame.ned_from_runway) == pytest.approx(1.0)
