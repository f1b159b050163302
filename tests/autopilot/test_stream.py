"""When the stream speaks and when it is silent, at which rate, with which reset counter, of which point."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.received import receive
from groundstation.autopilot.settings import MOST_DELAY_S, AutopilotMode, AutopilotSettings
from groundstation.autopilot.stream import AutopilotStream
from groundstation.autopilot.vehicle_attitude import VehicleAttitude
from groundstation.autopilot.vehicle_delay import delay_parameters
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.errors import ConfigError
from groundstation.messages import TrackStatus
from tests.autopilot.flights import (
    ORIGIN,
    SEPARATION_M,
    StraightFlight,
    answer,
    listed,
    one_state,
    sent_states,
    stream_of,
    symmetric,
    values,
)

_MODES = list(AutopilotMode)


def _flown(
    stream: AutopilotStream, flight: StraightFlight, from_s: float, to_s: float, **status: object
) -> list[float]:
    """Fly at 25 pairs a second, polled each 10 ms; return the times at which a state was sent."""
    times = []
    for k in range(round(100 * (to_s - from_s))):
        t_s = from_s + 0.01 * k
        if k % 4 == 0:
            stream.note(answer(flight, t_s, **status))  # type: ignore[arg-type]
        times += [t_s] * len(sent_states(stream.messages(t_s, VehicleState())))
    return times


@pytest.mark.parametrize(
    ("mode", "rate_hz"),
    [
        (AutopilotMode.GPS_INPUT, 10.0),
        (AutopilotMode.GLOBAL_POSITION, 20.0),
        (AutopilotMode.VISION, 40.0),
        (AutopilotMode.ODOMETRY, 40.0),
    ],
)
def test_messages_are_evenly_spaced_at_the_modes_rate(mode: AutopilotMode, rate_hz: float) -> None:
    flight = StraightFlight()
    times = _flown(stream_of(flight, mode), flight, 1.0, 6.0)
    assert len(times) == pytest.approx(5.0 * rate_hz, abs=1)
    # polled each 10 ms, a message is up to so much late
    assert max(abs(np.diff(times) - 1.0 / rate_hz)) <= 0.0101


@pytest.mark.parametrize(
    ("autopilot", "settings", "rate_hz"), [(3, {}, 20.0), (12, {}, 40.0), (3, {"rate_hz": 50.0}, 50.0)]
)
def test_over_a_radio_whose_delay_varies_ardupilot_gets_fewer(
    autopilot: int, settings: dict[str, float], rate_hz: float
) -> None:
    """Expected: at a steady link the mode's rate; 20 Hz once the delay has varied, unless a rate is asked for."""
    flight, vehicle = StraightFlight(), VehicleState(autopilot=autopilot)
    stream = stream_of(flight, AutopilotMode.ODOMETRY, **settings)
    for delays_s, wanted_hz in (((0.05, 0.052) * 10, settings.get("rate_hz", 40.0)), ((0.03, 0.2) * 20, rate_hz)):
        for delay_s in delays_s:
            vehicle.link_delay.answered(0.0, delay_s, delay_s + 0.05)
        sent = 0
        for k in range(400):
            t_s = 1.0 + 0.005 * k
            stream.note(answer(flight, t_s))
            sent += len(sent_states(stream.messages(t_s, vehicle)))
        assert sent == pytest.approx(2.0 * wanted_hz, abs=2)
        stream = stream_of(flight, AutopilotMode.ODOMETRY, **settings)


def test_a_poll_that_comes_late_does_not_send_a_burst() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION)
    _flown(stream, flight, 1.0, 2.0)
    stream.note(answer(flight, 2.4))
    assert len(sent_states(stream.messages(2.45, VehicleState()))) == 1
    assert not sent_states(stream.messages(2.452, VehicleState()))


@pytest.mark.parametrize("mode", _MODES)
@pytest.mark.parametrize("status", [TrackStatus.SEARCHING, TrackStatus.ACQUIRING, TrackStatus.LOST])
def test_without_a_track_it_is_silent(mode: AutopilotMode, status: TrackStatus) -> None:
    flight = StraightFlight()
    stream = stream_of(flight, mode)
    assert not _flown(stream, flight, 0.0, 1.0, status=status, seen_by=())
    assert status.value in stream.silent_because
    assert _flown(stream, flight, 1.0, 2.0)
    assert not _flown(stream, flight, 2.0, 3.0, status=status, seen_by=())


@pytest.mark.parametrize("mode", _MODES)
def test_what_no_camera_has_seen_lately_is_not_sent(mode: AutopilotMode) -> None:
    flight = StraightFlight()
    stream = stream_of(flight, mode)
    _flown(stream, flight, 0.0, 1.0)
    # expected: the last picture of 0.96 s bears for 0.3 s, whatever the filter extrapolates
    times = _flown(stream, flight, 1.0, 3.0, status=TrackStatus.COASTING, seen_by=())
    assert times
    assert max(times) <= 0.96 + 0.3 + 1e-9
    # no answer at all: the same
    stream = stream_of(flight, mode)
    _flown(stream, flight, 0.0, 1.0)
    late = [t for t in np.arange(1.0, 3.0, 0.01) if sent_states(stream.messages(float(t), VehicleState()))]
    assert max(late) <= 0.96 + 0.3 + 1e-9


@pytest.mark.parametrize("mode", _MODES)
def test_no_stamp_comes_twice_or_goes_back(mode: AutopilotMode) -> None:
    flight = StraightFlight()
    stream = stream_of(flight, mode)
    stamps: list[int] = []
    link_delays = iter([0.02, 0.2, 0.0, 0.4] * 500)
    for k in range(400):
        t_s = 1.0 + 0.01 * k
        stream.note(answer(flight, t_s))
        vehicle = VehicleState()
        for _ in range(3):
            delay_s = next(link_delays)
            vehicle.link_delay.answered(0.0, delay_s, 2.0 * delay_s)
        for message in sent_states(stream.messages(t_s, vehicle)):
            key = "usec" if mode is AutopilotMode.VISION else "time_usec"
            stamps.append(message.fields[key])  # type: ignore[arg-type]
    assert len(stamps) > 10
    assert all(b > a for a, b in itertools.pairwise(stamps))


def test_a_sigma_of_ten_metres_is_no_position() -> None:
    flight = StraightFlight()
    flight.covariance = np.diag([1.0, 11.0, 1.0, 0.1, 0.1, 0.1]) ** 2
    stream = stream_of(flight, AutopilotMode.GPS_INPUT)
    assert not _flown(stream, flight, 0.0, 1.0)
    assert "one sigma" in stream.silent_because


@pytest.mark.parametrize("mode", _MODES)
def test_a_new_tracks_velocity_that_is_hardly_known_is_not_sent_as_a_receivers(mode: AutopilotMode) -> None:
    """Expected: GPS_INPUT alone is silent until the rms over three axes is 3 m/s, once in a track; then it goes on."""
    flight = StraightFlight()
    stream = stream_of(flight, mode)
    rough, fine = (np.diag([0.03, 0.4, 0.04, 0.05, along, 0.05]) ** 2 for along in (6.0, 5.0))
    flight.covariance = rough
    waits = mode is AutopilotMode.GPS_INPUT
    assert bool(_flown(stream, flight, 0.0, 1.0)) is not waits
    flight.covariance = fine
    assert _flown(stream, flight, 1.0, 2.0)
    flight.covariance = rough
    assert _flown(stream, flight, 2.0, 3.0)
    told = {"a new track's velocity is not known to 3 m/s yet (1 σ)"} if waits else set()
    assert set(stream.statistics.withheld) == told
    # the next track
    _flown(stream, flight, 3.0, 3.2, status=TrackStatus.ACQUIRING)
    assert bool(_flown(stream, flight, 3.2, 4.0)) is not waits


@pytest.mark.parametrize("broken", [math.nan, math.inf, -1.0])
def test_numbers_that_are_none_are_never_sent(broken: float) -> None:
    flight = StraightFlight()
    flight.covariance = np.diag([broken, 1.0, 1.0, 0.1, 0.1, 0.1])
    assert not _flown(stream_of(flight, AutopilotMode.VISION), flight, 0.0, 1.0)


def test_the_reset_counter_moves_for_a_real_reset_only() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION)
    assert _counter(stream, flight, 1.0) == 0
    for k in range(100):
        assert _counter(stream, flight, 1.1 + 0.1 * k) == 0
    # a gap without a loss, the same track: none
    assert _counter(stream, flight, 13.0) == 0
    # restarted elsewhere, 4 m off at a sigma of 0.4 m
    flight.offset_m = np.array([0.0, 4.0, 0.0])
    assert _counter(stream, flight, 13.1) == 1
    assert _counter(stream, flight, 13.2) == 1
    # lost and found again
    stream.note(answer(flight, 13.3, TrackStatus.LOST, ()))
    assert _counter(stream, flight, 14.0) == 2
    assert stream.statistics.resets == 2


def test_a_hard_turn_is_no_reset() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION)
    # 8 m/s² to the one side and to the other
    for k in range(100):
        assert _counter(stream, flight, 1.0 + 0.025 * k) == 0
        acceleration = np.array([8.0 * (-1) ** (k // 10), 0.0, 0.0])
        # the state of the next message: where it has been accelerated to
        flight.offset_m = flight.offset_m + acceleration * (0.5 * 0.025**2 - 0.025 * (1.025 + 0.025 * k))
        flight.velocity = flight.velocity + acceleration * 0.025


def _counter(stream: AutopilotStream, flight: StraightFlight, t_s: float) -> int:
    counter = one_state(stream, flight, t_s, VehicleState()).fields["reset_counter"]
    assert isinstance(counter, int)
    return counter


def test_each_second_a_heartbeat_and_a_time_request_whether_it_tracks_or_not() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION)
    names = [m.name for k in range(500) for m in stream.messages(0.01 * k, VehicleState())]
    assert names.count("HEARTBEAT") == 5
    assert names.count("TIMESYNC") == 5
    # the local frame's origin, until the vehicle tells one
    assert names.count("SET_GPS_GLOBAL_ORIGIN") == 5
    known = VehicleState(system=1, global_origin=(47.3, 8.5, 400.0))
    stream = stream_of(flight, AutopilotMode.VISION)
    assert "SET_GPS_GLOBAL_ORIGIN" not in [m.name for k in range(500) for m in stream.messages(0.01 * k, known)]


def test_the_delay_of_the_link_is_predicted_over() -> None:
    flight = StraightFlight()
    vehicle = VehicleState()
    for _ in range(5):
        vehicle.link_delay.answered(0.0, 0.08, 0.16)
    there = one_state(stream_of(flight, AutopilotMode.VISION), flight, 2.0, vehicle)
    # expected: where it will be 80 ms later, when the message arrives
    moved = np.linalg.norm(np.diff([flight.position(2.0), flight.position(2.08)], axis=0))
    here = one_state(stream_of(flight, AutopilotMode.VISION), flight, 2.0, VehicleState())
    assert math.dist(values(there, "x", "y", "z"), values(here, "x", "y", "z")) == pytest.approx(moved)


@pytest.mark.parametrize("mode", _MODES)
def test_a_delay_beyond_the_vehicles_horizon_is_refused(mode: AutopilotMode) -> None:
    with pytest.raises(ConfigError, match="filter refuses"):
        AutopilotSettings(url="udpout:127.0.0.1:1", mode=mode, delay_s=MOST_DELAY_S[mode] + 0.01)
    flight = StraightFlight()
    name = delay_parameters(AutopilotSettings(url="udpout:127.0.0.1:1", mode=mode))[0]
    vehicle = VehicleState(parameters={name: 300.0})
    stream = stream_of(flight, mode)
    stream.note(answer(flight, 2.0))
    assert not sent_states(stream.messages(2.0, vehicle))
    assert "300 ms" in stream.silent_because


_ARM = (-0.8, 0.1, -0.2)


def test_the_lever_arm_is_turned_by_the_vehicles_attitude() -> None:
    flight = StraightFlight()
    stream = stream_of(flight, AutopilotMode.VISION, arm_m=_ARM)
    attitude = VehicleAttitude.from_euler(2.0, 0.3, 0.1, 1.2, np.array([0.0, 0.0, 0.5]))
    assert attitude is not None
    moved = one_state(stream, flight, 2.0, VehicleState(attitude=attitude))
    plain = one_state(stream_of(flight, AutopilotMode.VISION), flight, 2.0, VehicleState())
    difference = values(moved, "x", "y", "z") - values(plain, "x", "y", "z")
    np.testing.assert_allclose(difference, attitude.ned_from_body @ np.array(_ARM), atol=1e-9)


@pytest.mark.parametrize("crab_deg", [-15.0, 0.0, 15.0])
def test_without_an_attitude_a_crab_of_fifteen_degrees_is_within_two_sigma(crab_deg: float) -> None:
    flight = StraightFlight()
    arm = (-1.2, 0.0, 0.0)
    with_arm = one_state(stream_of(flight, AutopilotMode.VISION, arm_m=arm), flight, 2.0, VehicleState())
    plain = one_state(stream_of(flight, AutopilotMode.VISION), flight, 2.0, VehicleState())
    velocity = np.array([-math.cos(math.pi / 6), -math.sin(math.pi / 6)])
    crab = math.radians(crab_deg)
    nose = np.array(
        [
            math.cos(crab) * velocity[0] - math.sin(crab) * velocity[1],
            math.sin(crab) * velocity[0] + math.cos(crab) * velocity[1],
        ]
    )
    true = values(plain, "x", "y") - 1.2 * nose
    error = values(with_arm, "x", "y") - true
    covariance = symmetric(listed(with_arm, "covariance"))
    # expected: the error is across the track, where the nose's sigma is 3 cm, and the arm's 0.21 m
    across = np.array([-velocity[1], velocity[0]])
    sigma = math.sqrt(across @ covariance[:2, :2] @ across)
    assert abs(across @ error) == pytest.approx(1.2 * abs(math.sin(crab)), abs=1e-6)
    assert abs(across @ error) <= 2.0 * sigma


def test_an_old_attitude_is_none() -> None:
    attitude = VehicleAttitude.from_euler(1.0, 0.0, 0.0, 0.0, np.zeros(3))
    assert attitude is not None
    assert attitude.at(1.4) is not None
    assert attitude.at(1.6) is None


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(_MODES),
    st.lists(
        st.tuples(st.sampled_from(list(TrackStatus)), st.integers(0, 2), st.floats(0.0, 1.0)), min_size=1, max_size=40
    ),
)
def test_it_never_speaks_without_a_fresh_picture(
    mode: AutopilotMode, steps: list[tuple[TrackStatus, int, float]]
) -> None:
    """Expected: over any sequence of answers and gaps, only within 0.3 s of a pixel, and while tracked."""
    flight = StraightFlight()
    stream = stream_of(flight, mode)
    t_s, fix_s, last = 1.0, -math.inf, TrackStatus.SEARCHING
    for status, cameras, gap_s in steps:
        stream.note(answer(flight, t_s, status, ("left", "right")[:cameras]))
        last = status
        if cameras and status in (TrackStatus.TRACKING, TrackStatus.COASTING):
            fix_s = t_s
        for k in range(int(gap_s / 0.02) + 1):
            now_s = t_s + 0.02 * k
            if sent_states(stream.messages(now_s, VehicleState())):
                assert now_s - fix_s <= 0.3 + 1e-9
                assert last in (TrackStatus.TRACKING, TrackStatus.COASTING)
        t_s += gap_s + 0.02


def test_what_arrives_by_the_fastest_is_predicted_by_the_fastest() -> None:
    """Expected: ArduPilot counts each message as being as fast as the fastest, PX4 by its own arrival."""
    flight = StraightFlight()
    vehicle = VehicleState()
    for trip_s in (0.06, 0.2, 0.4):
        vehicle.link_delay.answered(0.0, 0.5 * trip_s, trip_s)
    gps = stream_of(flight, AutopilotMode.GPS_INPUT)
    vision = stream_of(flight, AutopilotMode.VISION)
    assert gps.link_delay_s(vehicle) == pytest.approx(0.03)
    vehicle.autopilot = 12
    assert vision.link_delay_s(vehicle) == pytest.approx(0.1)
    vehicle.autopilot = 3
    assert vision.link_delay_s(vehicle) == pytest.approx(0.03)


def test_a_global_position_ahead_of_its_sending_has_no_age() -> None:
    flight = StraightFlight()
    vehicle = VehicleState()
    for _ in range(3):
        vehicle.link_delay.answered(0.0, 0.08, 0.16)
    message = one_state(stream_of(flight, AutopilotMode.GLOBAL_POSITION), flight, 2.0, vehicle)
    # the state of 80 ms later
    assert message.fields["time_usec"] == 1_002_080_000
    assert message.fields["processing_time"] == 0


@pytest.mark.parametrize("told_s", [0.05, None])
def test_an_error_of_the_links_delay_is_one_along_the_track(told_s: float | None) -> None:
    """Expected: v v' sigma² more in the covariance; by TIMESYNC where it is not told, 20 ms before any answer."""
    flight, sigma_s = StraightFlight(), 0.02 if told_s is None else told_s
    covariances = []
    for of in (0.0, told_s):
        stream = stream_of(flight, AutopilotMode.ODOMETRY, link_delay_sigma_s=of)
        message = one_state(stream, flight, 2.0, VehicleState())
        covariances.append(symmetric(listed(message, "pose_covariance"))[:3, :3])
    velocity = LocalFrame(ORIGIN, SEPARATION_M).ned_from_runway @ flight.velocity
    np.testing.assert_allclose(covariances[1] - covariances[0], sigma_s**2 * np.outer(velocity, velocity), atol=1e-9)


def test_ardupilots_stamps_keep_their_distance_from_the_sending() -> None:
    """Expected: what is learnt of the link moves the state that is sent, by as much, and no stamp."""
    flight, vehicle = StraightFlight(), VehicleState(autopilot=3)
    stream = stream_of(flight, AutopilotMode.VISION)
    sent = []
    for t_s, delay_s in ((2.0, 0.1), (3.0, 0.03)):
        for _ in range(3):
            vehicle.link_delay.answered(0.0, delay_s, 2.0 * delay_s)
        message = one_state(stream, flight, t_s, vehicle)
        sent.append((message.fields["usec"], values(message, "x", "y", "z")))
    (first_us, first), (second_us, second) = sent
    assert second_us - first_us == 1_000_000  # type: ignore[operator]
    moved = np.linalg.norm(np.diff([flight.position(2.1), flight.position(3.03)], axis=0))
    assert math.dist(first, second) == pytest.approx(moved)


def test_what_arrives_later_than_ekf3_remembers_is_in_its_covariance() -> None:
    """Expected: of delays of 30 and 130 ms nothing with a memory of 250 ms, else the rms of 100 ms in each fourth."""
    sigma = {}
    for memory_ms in (250.0, 50.0):
        vehicle = VehicleState(autopilot=3, parameters={"GPS1_DELAY_MS": 100.0, "EK3_BCN_DELAY": memory_ms})
        for k in range(100):
            there_s = 0.13 if k % 4 == 0 else 0.03
            vehicle.link_delay.answered(0.0, there_s, there_s + 0.03)
        stream = stream_of(StraightFlight(), AutopilotMode.GPS_INPUT, link_delay_sigma_s=None)
        sigma[memory_ms] = stream.link_delay_sigma_s(vehicle)
    assert sigma[250.0] < 0.005
    assert sigma[50.0] == pytest.approx(0.05, abs=0.001)


def test_a_vehicle_whose_clock_is_set_is_measured_from_the_start() -> None:
    """Expected: after a restart of the vehicle's clock its delay is that of the new answers, three of them at least."""
    link = VehicleState().link_delay
    for clock_s in (500.0, 0.0):
        for k in range(3):
            assert link.one_way_s is None or clock_s == 0.0
            link.answered(float(k), clock_s + k + 0.04, k + 0.1)
        assert link.one_way_s == pytest.approx(0.05)
    # a clock that is none: it never moves
    still = VehicleState().link_delay
    for k in range(10):
        still.answered(float(k), 1.0, k + 0.1)
    assert still.one_way_s is None


def test_jitter_of_one_way_is_not_taken_for_delay_of_the_other() -> None:
    """Expected: a way back that is slow and varies leaves the delay there, 40 ms, as it is; the fastest are equal."""
    link = VehicleState().link_delay
    rng = np.random.default_rng(3)
    for back_s in [0.04, *rng.uniform(0.04, 0.4, 60)]:
        link.answered(0.0, 777.04, 0.04 + back_s)
    assert link.one_way_s == pytest.approx(0.04)
    assert link.least_one_way_s == pytest.approx(0.04)


def test_what_is_taken_for_the_fastest_is_off_by_what_the_fastest_differ_by() -> None:
    """Expected: 20 ms before three answers; then what the third is slower, and a tenth of the fastest's delay."""
    link = VehicleState().link_delay
    assert link.least_sigma_s == 0.02
    for there_s in (0.05, 0.2, 0.06, 0.07, 0.19):
        link.answered(0.0, there_s, there_s + 0.05)
    assert link.least_sigma_s == pytest.approx(math.hypot(0.02, 0.005))


def test_answers_are_received_with_the_vehicles_clock_each_way() -> None:
    """Expected: 30 ms there of the fastest, 40 of the median, whatever the way back and the vehicle's clock."""
    vehicle = VehicleState(system=1)
    for k, (there_s, back_s) in enumerate([(0.03, 0.3), (0.05, 0.03), (0.04, 0.2)]):
        sent_s = 10.0 + k
        fields = {"tc1": round(1e9 * (77.0 + sent_s + there_s)), "ts1": round(1e9 * (1000.0 + sent_s))}
        receive(vehicle, "TIMESYNC", fields, (1, 1), sent_s + there_s + back_s, link_s=1000.0)
    assert vehicle.link_delay.least_one_way_s == pytest.approx(0.03)
    assert vehicle.link_delay.one_way_s == pytest.approx(0.04)


def test_what_other_components_of_the_vehicle_say_is_not_the_autopilots() -> None:
    """A companion computer answers TIMESYNC by its own clock, a gimbal tells its own attitude: both are passed over."""
    vehicle = VehicleState()
    for source, autopilot in (((1, 154), 8), ((1, 1), 3), ((1, 191), 0)):
        receive(vehicle, "HEARTBEAT", {"autopilot": autopilot}, source, 9.0, link_s=1000.0)
    assert (vehicle.system, vehicle.component, vehicle.autopilot) == (1, 1, 3)
    level = {"rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0, "roll": 0.0, "pitch": 0.0}
    for k in range(10):
        sent_s = 10.0 + k
        for component, clock_s in ((1, 77.0), (191, 5e8)):
            fields = {"tc1": round(1e9 * (clock_s + sent_s + 0.05)), "ts1": round(1e9 * (1000.0 + sent_s))}
            receive(vehicle, "TIMESYNC", fields, (1, component), sent_s + 0.1, link_s=1000.0)
        receive(vehicle, "ATTITUDE", level | {"yaw": 1.0}, (1, 1), sent_s, link_s=1000.0)
        receive(vehicle, "ATTITUDE", level | {"yaw": -2.0}, (1, 154), sent_s, link_s=1000.0)
    assert vehicle.link_delay.answers == 10
    assert vehicle.link_delay.one_way_s == pytest.approx(0.05, abs=1e-6)
    assert vehicle.attitude is not None
    assert math.atan2(vehicle.attitude.ned_from_body[1, 0], vehicle.attitude.ned_from_body[0, 0]) == pytest.approx(1.0)


def test_a_vehicle_that_has_started_again_gets_the_origin_again() -> None:
    """Expected: none once it has told its origin, each second again after its clock has begun again."""
    flight, vehicle = StraightFlight(), VehicleState(system=1, global_origin=(50.0, 10.0, 300.0))
    stream = stream_of(flight, AutopilotMode.VISION)
    for sent_s, clock_s, wanted in ((10.0, 500.0, False), (12.0, 502.0, False), (14.0, 3.0, True), (16.0, 5.0, True)):
        fields = {"tc1": round(1e9 * clock_s), "ts1": round(1e9 * (1000.0 + sent_s))}
        receive(vehicle, "TIMESYNC", fields, (1, 1), sent_s + 0.05, link_s=1000.0)
        names = [message.name for message in stream.messages(sent_s + 1.0, vehicle)]
        assert ("SET_GPS_GLOBAL_ORIGIN" in names) is wanted


@pytest.mark.parametrize(
    ("autopilot", "memory_ms", "words"),
    [
        (12, 0.0, "misdated by 55 ms (1 σ)"),
        (3, 50.0, "EKF3 remembers 200 ms (EK3_BCN_DELAY)"),
        (3, 250.0, "misdated by 43 ms (1 σ)"),
    ],
)
def test_a_link_whose_delay_varies_is_told(autopilot: int, memory_ms: float, words: str) -> None:
    """Expected: half of the messages 110 ms late: 55 ms; of ArduPilot the rms of what EKF3 forgets, 110 or 60 ms."""
    vehicle = VehicleState(autopilot=autopilot, parameters={"EK3_BCN_DELAY": memory_ms})
    mode = AutopilotMode.ODOMETRY if autopilot == 12 else AutopilotMode.GPS_INPUT
    stream = stream_of(StraightFlight(), mode, link_delay_sigma_s=None)
    assert stream.doubt(vehicle) == ""
    for k in range(60):
        there_s = 0.14 if k % 2 else 0.03
        vehicle.link_delay.answered(0.0, there_s, there_s + 0.03)
    assert words in stream.doubt(vehicle)


def test_a_delay_that_is_told_late_moves_no_stamp() -> None:
    """Expected: of GPS_INPUT, milliseconds of the week keep their distance from the sending when 50 ms are told."""
    flight, vehicle = StraightFlight(), VehicleState(autopilot=3)
    stream = stream_of(flight, AutopilotMode.GPS_INPUT)
    sent = [one_state(stream, flight, 2.0, vehicle)]
    vehicle.parameters["GPS1_DELAY_MS"] = 50.0
    sent.append(one_state(stream, flight, 3.0, vehicle))
    first_ms, second_ms = (message.fields["time_week_ms"] for message in sent)
    assert second_ms - first_ms == 1000  # type: ignore[operator]
    # expected: 1 s, and the 150 ms that the vehicle subtracts no more, farther on
    frame = LocalFrame(ORIGIN, SEPARATION_M)
    here, there = (frame.runway_position(*(1e-7 * values(m, "lat", "lon")), 0.0) for m in sent)
    apart_m = math.dist(here, there)
    flown_m = float(np.linalg.norm((flight.position(2.95) - flight.position(1.8))[:2]))
    assert apart_m == pytest.approx(flown_m, abs=0.05)
