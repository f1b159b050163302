"""What the autopilots' receivers take of the stream, and what not: each rule broken in turn, and a landing streamed."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.settings import AutopilotMode
from groundstation.autopilot.vehicle_state import ARDUPILOT, PX4, VehicleState
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.autopilot_receivers.ardupilot_external_navigation import (
    ExternalNavigationParameters,
    ExternalNavigationReceiver,
)
from groundstation.simulation.autopilot_receivers.ardupilot_gps import ArdupilotGpsParameters, ArdupilotGpsReceiver
from groundstation.simulation.autopilot_receivers.landing_streams import SITE_FRAME, streamed_landing
from groundstation.simulation.autopilot_receivers.least_lag import LeastLagClock
from groundstation.simulation.autopilot_receivers.px4_receivers import (
    Px4GlobalParameters,
    Px4GlobalReceiver,
    Px4VisionParameters,
    Px4VisionReceiver,
)
from groundstation.simulation.autopilot_receivers.radio_link import RadioLink, RadioLinkModel
from groundstation.simulation.autopilot_receivers.receipt import PositionReceiver, ReceiptVerdict
from tests.autopilot.flights import CLOCK, StraightFlight, one_state, stream_of, values


def _sent(mode: AutopilotMode, t_s: float = 2.0, **changed: object) -> MavlinkMessage:
    flight = StraightFlight()
    message = one_state(stream_of(flight, mode), flight, t_s, VehicleState())
    return dataclasses.replace(message, fields={**message.fields, **changed})


def _gps() -> PositionReceiver:
    return ArdupilotGpsReceiver(SITE_FRAME, ArdupilotGpsParameters(beacon_delay_ms=250.0))


def _external() -> PositionReceiver:
    return ExternalNavigationReceiver(SITE_FRAME, ExternalNavigationParameters(least_quality=20))


def _px4_vision() -> PositionReceiver:
    return Px4VisionReceiver(SITE_FRAME, Px4VisionParameters(least_quality=20), None)


def _px4_global() -> PositionReceiver:
    return Px4GlobalReceiver(SITE_FRAME, Px4GlobalParameters(), None)


@pytest.mark.parametrize(
    ("receiver", "message", "verdict"),
    [
        (_gps(), _sent(AutopilotMode.GPS_INPUT, gps_id=1), ReceiptVerdict.OTHER_INSTANCE),
        (_gps(), _sent(AutopilotMode.GPS_INPUT, fix_type=2), ReceiptVerdict.NO_FIX),
        (_gps(), _sent(AutopilotMode.GPS_INPUT, lat=0, lon=0), ReceiptVerdict.NO_FIX),
        (_gps(), _sent(AutopilotMode.GPS_INPUT, time_week=0), ReceiptVerdict.NO_WEEK),
        (_gps(), _sent(AutopilotMode.GPS_INPUT, alt=math.nan), ReceiptVerdict.NOT_FINITE),
        (_gps(), _sent(AutopilotMode.ODOMETRY), ReceiptVerdict.NOT_SELECTED),
        (_external(), _sent(AutopilotMode.ODOMETRY, frame_id=1), ReceiptVerdict.WRONG_FRAMES),
        (_external(), _sent(AutopilotMode.ODOMETRY, child_frame_id=8), ReceiptVerdict.WRONG_FRAMES),
        (_external(), _sent(AutopilotMode.ODOMETRY, x=math.nan), ReceiptVerdict.NOT_FINITE),
        (_external(), _sent(AutopilotMode.ODOMETRY, quality=10), ReceiptVerdict.LOW_QUALITY),
        # it has no quality of its own, and counts as 0
        (_external(), _sent(AutopilotMode.VISION), ReceiptVerdict.LOW_QUALITY),
        (_px4_vision(), _sent(AutopilotMode.ODOMETRY, quality=10), ReceiptVerdict.LOW_QUALITY),
        (_px4_vision(), _sent(AutopilotMode.ODOMETRY, frame_id=12), ReceiptVerdict.WRONG_FRAMES),
        (_px4_vision(), _sent(AutopilotMode.GPS_INPUT), ReceiptVerdict.NOT_SELECTED),
        (_px4_global(), _sent(AutopilotMode.GLOBAL_POSITION, id=2), ReceiptVerdict.OTHER_INSTANCE),
    ],
)
def test_what_breaks_a_rule_is_refused_by_its_name(
    receiver: PositionReceiver, message: MavlinkMessage, verdict: ReceiptVerdict
) -> None:
    receipt = receiver.receive(message, 50.0)
    assert receipt.verdict is verdict
    assert receipt.sample is None


@pytest.mark.parametrize(
    ("mode", "receiver", "delay_s"),
    [(AutopilotMode.GPS_INPUT, _gps(), 0.2), (AutopilotMode.ODOMETRY, _external(), 0.01)],
)
def test_ardupilot_takes_the_fastest_message_for_the_delay_of_all(
    mode: AutopilotMode, receiver: PositionReceiver, delay_s: float
) -> None:
    arrived = {2.0: 50.03, 2.3: 50.37}
    taken = [receiver.receive(_sent(mode, t_s), now_s).sample for t_s, now_s in arrived.items()]
    # expected: the second came 40 ms late, and is attributed as if it had not
    assert [s.t_s for s in taken if s is not None] == pytest.approx([50.03 - delay_s, 50.33 - delay_s], abs=0.0011)


def test_ardupilot_takes_an_old_gps_sample_for_one_of_a_quarter_second() -> None:
    receiver = _gps()
    assert receiver.receive(_sent(AutopilotMode.GPS_INPUT, 2.0), 50.0).verdict is ReceiptVerdict.ACCEPTED
    late = receiver.receive(_sent(AutopilotMode.GPS_INPUT, 2.1), 50.16)
    assert late.verdict is ReceiptVerdict.HELD
    assert late.sample is not None
    assert late.sample.t_s == pytest.approx(50.16 - 0.25)


def test_ardupilot_holds_the_largest_accuracy_stated() -> None:
    """Expected: a fifth is lost each second, what is stated then is taken if it is more, and 0.5 m/s is the least."""
    receiver = _gps()
    sigmas = []
    for k, stated_m_s in enumerate((30.0, 1.0, 1.0, 1.0, 20.0, 1.0)):
        message = _sent(AutopilotMode.GPS_INPUT, 2.0 + k, speed_accuracy=stated_m_s)
        sample = receiver.receive(message, 50.0 + k).sample
        assert sample is not None
        sigmas.append(sample.sigma_speed_m_s)
    assert sigmas == pytest.approx([30.0, 24.0, 19.2, 15.36, 20.0, 16.0], rel=1e-3)
    quiet = _gps().receive(_sent(AutopilotMode.GPS_INPUT, speed_accuracy=0.1), 50.0).sample
    assert quiet is not None
    assert quiet.sigma_speed_m_s == 0.5


@pytest.mark.parametrize(
    ("delay_ms", "beacon_delay_ms", "memory_s"), [(50.0, 50.0, 0.1), (0.0, 50.0, 0.2), (50.0, 250.0, 0.25)]
)
def test_ardupilot_remembers_as_long_as_its_slowest_sensor(
    delay_ms: float, beacon_delay_ms: float, memory_s: float
) -> None:
    """Expected: 100 ms for the airspeed, 200 ms for a receiver by its driver's own delay, or what is stated."""
    parameters = ArdupilotGpsParameters(delay_ms=delay_ms, beacon_delay_ms=beacon_delay_ms)
    receiver = ArdupilotGpsReceiver(SITE_FRAME, parameters)
    receiver.receive(_sent(AutopilotMode.GPS_INPUT, 2.0), 50.0)
    late = receiver.receive(_sent(AutopilotMode.GPS_INPUT, 2.1), 50.5)
    assert late.verdict is ReceiptVerdict.HELD
    assert late.sample is not None
    assert late.sample.t_s == pytest.approx(50.5 - memory_s)


def test_ardupilot_drops_external_navigation_above_fifty_hertz_and_names_it_unhealthy_without() -> None:
    receiver = ExternalNavigationReceiver(SITE_FRAME, ExternalNavigationParameters())
    assert not receiver.healthy(50.0)
    assert receiver.receive(_sent(AutopilotMode.ODOMETRY, 2.0), 50.0).verdict is ReceiptVerdict.ACCEPTED
    assert receiver.receive(_sent(AutopilotMode.ODOMETRY, 2.015), 50.015).verdict is ReceiptVerdict.TOO_SOON
    again = receiver.receive(_sent(AutopilotMode.ODOMETRY, 2.03, reset_counter=1), 50.03).sample
    assert again is not None
    assert again.reset
    # of 0.35, 0.20 and 0.04 m north, east and down: the cube root of the sum of the squared variances
    assert again.sigma_horizontal_m == pytest.approx(np.cbrt(0.1202**2 + 0.0407**2 + 0.0016**2), abs=1e-3)
    coarse = ExternalNavigationReceiver(SITE_FRAME, ExternalNavigationParameters(position_noise_m=0.3))
    floored = coarse.receive(_sent(AutopilotMode.ODOMETRY, 2.0), 50.0).sample
    assert floored is not None
    assert floored.sigma_horizontal_m == 0.3
    np.testing.assert_array_equal(floored.position_sigma_ned_m(), 0.3)
    assert receiver.healthy(50.3)
    assert not receiver.healthy(50.34)


def test_px4_starts_with_two_samples_and_stops_after_a_gap() -> None:
    receiver = Px4VisionReceiver(SITE_FRAME, Px4VisionParameters(), 50.0 - 2.0 - CLOCK.link_s)
    times = (2.0, 2.15, 2.5, 2.6, 3.1, 3.2)
    found = [receiver.receive(_sent(AutopilotMode.VISION, t), 48.0 + t + 0.03).verdict for t in times]
    begun, taken = ReceiptVerdict.STARTING, ReceiptVerdict.ACCEPTED
    assert found == [begun, taken, taken, taken, begun, taken]
    assert receiver.receive(_sent(AutopilotMode.VISION, 3.3), 51.5).verdict is ReceiptVerdict.TOO_OLD
    sample = receiver.receive(_sent(AutopilotMode.VISION, 3.35), 51.36).sample
    assert sample is not None
    # 3 cm and 4 cm are below EKF2_EVP_NOISE, 40 cm are not
    assert (sample.sigma_horizontal_m, sample.sigma_vertical_m) == pytest.approx((0.35, 0.1), abs=0.06)
    # of each axis its own: 0.35, 0.20 and 0.04 m north, east and down
    np.testing.assert_allclose(sample.position_sigma_ned_m(), (0.35, 0.2, 0.1), atol=0.06)


def test_the_clock_by_the_least_lag_forgets_and_has_a_limit() -> None:
    clock = LeastLagClock(0.5)
    assert clock.local_s(1.0, 11.0) == 11.0
    assert clock.local_s(2.0, 12.2) == 12.0
    assert clock.local_s(3.0, 13.8) == pytest.approx(13.3)
    for k in range(300):
        local_s = clock.local_s(4.0 + k, 14.1 + k)
    assert local_s == pytest.approx(313.1)


def test_a_radio_keeps_the_order_and_loses_its_share() -> None:
    radio = RadioLink(RadioLinkModel(), np.random.default_rng(1))
    message = _sent(AutopilotMode.VISION)
    for k in range(2000):
        radio.send(message, 0.025 * k)
    times = [t for t, _ in radio.arrived(math.inf)]
    assert len(times) == 2000 - radio.lost
    assert radio.lost == pytest.approx(100, abs=30)
    assert np.all(np.diff(times) >= 0.0)


@pytest.mark.parametrize(("autopilot", "ahead_s"), [(ARDUPILOT, 0.03), (PX4, 0.08)])
def test_the_stream_leads_by_the_delay_that_the_autopilot_takes(autopilot: int, ahead_s: float) -> None:
    vehicle = VehicleState(autopilot=autopilot)
    for trip_s in (0.16, 0.06, 0.2):
        vehicle.link_delay.answered(0.0, 0.5 * trip_s, trip_s)
    flight = StraightFlight()
    stamp_us = values(one_state(stream_of(flight, AutopilotMode.VISION), flight, 2.0, vehicle), "usec")
    assert stamp_us == pytest.approx([CLOCK.link_us(2.0 + ahead_s)])


def test_a_global_position_ahead_of_its_sending_keeps_its_time() -> None:
    vehicle = VehicleState(autopilot=PX4)
    for _ in range(3):
        vehicle.link_delay.answered(0.0, 0.1, 0.2)
    flight = StraightFlight()
    message = one_state(stream_of(flight, AutopilotMode.GLOBAL_POSITION), flight, 2.0, vehicle)
    sent_us, age_us = values(message, "time_usec", "processing_time")
    assert sent_us - age_us == CLOCK.link_us(2.1)


def test_a_landing_is_taken_whole_over_a_steady_radio() -> None:
    """Expected: nothing is refused but what is lost, and where the delay is steady it is as good as the filter."""
    flight = GlideApproach(start_y_m=250.0, end_y_m=110.0, speed_m_s=20.0, aim_y_m=60.0)
    names = ("ArduPilot GPS_INPUT, GPS1_DELAY_MS 50", "PX4 ODOMETRY, stamped on arrival")
    radio = RadioLinkModel(delay_s=(0.05, 0.05))
    for found in streamed_landing(flight, 7.0, 3, names=names, radio=radio).values():
        assert set(found.verdicts) <= {ReceiptVerdict.ACCEPTED, ReceiptVerdict.STARTING}
        assert found.samples > 20
        rms, zero = (
            np.sqrt(s / n) for s, n in ((found.squares_m2, found.samples), (found.zero_delay_m2, found.estimates))
        )
        assert np.linalg.norm(rms) <= 1.2 * np.linalg.norm(zero)


def test_what_the_radio_varies_by_is_in_what_the_receiver_is_told() -> None:
    """Expected: over 30 to 200 ms a position is metres off along the track, and its sigma is not below that.

    Squared normalised errors have a mean of at most 1 for each axis; samples of one flight are dependent, so
    twice that is allowed for.
    """
    flight = GlideApproach(start_y_m=250.0, end_y_m=110.0, speed_m_s=20.0, aim_y_m=60.0)
    names = ("PX4 ODOMETRY, stamped on arrival", "PX4 GLOBAL_POSITION_SENSOR, stamped on arrival")
    for found in streamed_landing(flight, 7.0, 3, names=names).values():
        assert found.samples > 20
        assert np.linalg.norm(found.squares_m2) / found.samples > 0.3**2
        assert np.all(found.normalised / found.samples <= 2.0)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.002, 0.1))
def test_the_delays_scatter_is_found_from_round_trips(seed: int, sigma_s: float) -> None:
    """Expected: within the 1e-6 bounds of chi-square once 20 ms, worth two trips, count little."""
    rng = np.random.default_rng(seed)
    vehicle = VehicleState()
    assert vehicle.link_delay.one_way_sigma_s == 0.02
    for there_s, back_s in 0.5 + sigma_s * rng.standard_normal((30, 2)):
        vehicle.link_delay.answered(0.0, there_s, there_s + back_s)
    low, high = chi2.ppf([1e-6, 1.0 - 1e-6], 29)
    prior = 2.0 * 0.02**2
    least, most = (np.sqrt((prior + of * sigma_s**2) / 31.0) for of in (low, high))
    assert least <= vehicle.link_delay.one_way_sigma_s <= most
