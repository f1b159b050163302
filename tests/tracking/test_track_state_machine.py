"""A found target proves itself, or is dropped."""

import numpy as np
import pytest

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import TrackStatus
from groundstation.tracking.track_state_machine import TrackStateMachine
from tests.stereo_rig import make_rig


def started(found: bool) -> tuple[TrackStateMachine, StationEkf]:
    rig = make_rig()
    config = EstimationConfig()
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config)
    ekf.predict_to(0.0)
    at = np.array([0.0, 200.0, 8.0])
    ekf.start_target(at, np.zeros(3), np.diag([0.01, 0.25, 0.01, 0.01, 0.01, 0.01]))
    life = TrackStateMachine(config)
    life.start(0.0, at if found else None)
    return life, ekf


def move(ekf: StationEkf, y_m: float) -> None:
    kinematics = ekf.kinematics_at(0.0)
    there = kinematics.position_runway_m + [0.0, y_m, 0.0]
    ekf.start_target(there, np.array([0.0, y_m, 0.0]), kinematics.covariance)


def test_no_fix_within_the_time_for_it_is_false() -> None:
    life, ekf = started(found=True)
    assert life.update(False, ekf) is TrackStatus.ACQUIRING, "no estimate before the first fix"
    assert not life.confirmation.is_false_track(0.9, ekf)
    assert life.confirmation.is_false_track(1.1, ekf)


def test_fixes_without_motion_are_false_after_a_while() -> None:
    life, ekf = started(found=True)
    for k in range(30):
        life.add_fix(k * 0.1)
    assert not life.confirmation.is_false_track(3.0, ekf)
    assert life.confirmation.is_false_track(4.5, ekf)


def test_a_target_that_has_moved_away_is_confirmed_permanently() -> None:
    life, ekf = started(found=True)
    for k in range(5):
        life.add_fix(k * 0.1)
    move(ekf, -15.0)
    assert not life.confirmation.is_false_track(2.0, ekf)
    move(ekf, 15.0)
    assert not life.confirmation.is_false_track(60.0, ekf)


def proved(life: TrackStateMachine, ekf: StationEkf) -> None:
    for k in range(5):
        life.add_fix(k * 0.1)
    move(ekf, -15.0)
    assert not life.confirmation.is_false_track(2.0, ekf)


def test_what_has_moved_and_then_gets_nowhere_is_dropped() -> None:
    """As ground that the cameras cling to once the aircraft has gone: back and forth by 12 m, for 5 s."""
    life, ekf = started(found=True)
    proved(life, ekf)
    false_at = []
    for k in range(21, 90):
        life.add_fix(0.1 * k)
        move(ekf, 1.2 if k // 10 % 2 else -1.2)
        if life.confirmation.is_false_track(0.1 * k, ekf):
            false_at.append(0.1 * k)
    assert false_at[0] == pytest.approx(7.1, abs=0.3)


def test_the_slowest_approach_does_not_count_as_standing() -> None:
    life, ekf = started(found=True)
    proved(life, ekf)
    for k in range(21, 600):
        life.add_fix(k * 0.1)
        move(ekf, -0.5)
        assert not life.confirmation.is_false_track(k * 0.1, ekf)


def test_a_given_target_may_be_stationary() -> None:
    life, ekf = started(found=False)
    move(ekf, -15.0)
    assert not any(life.confirmation.is_false_track(float(t_s), ekf) for t_s in np.arange(0.0, 60.0, 0.5))


def test_a_given_target_needs_no_proof() -> None:
    life, ekf = started(found=False)
    assert not life.confirmation.is_false_track(100.0, ekf)
    assert life.update(False, ekf) is TrackStatus.COASTING


def test_time_and_covariance_lose_a_target() -> None:
    life, ekf = started(found=False)
    names = ("left", "right")
    for name in names:
        ekf.set_angles(name, (0.0, 0.03), (0.0, 0.0), 1e-5)
    assert not life.is_lost(1.0, ekf, names)
    assert life.is_lost(9.0, ekf, names), "eight seconds without a pixel"
    ekf.covariance[0, 0] = 30.0**2
    assert life.is_lost(1.0, ekf, names), "the cameras can't be told where to look"


def test_a_found_target_is_reported_once_its_velocity_has_settled() -> None:
    life, ekf = started(found=True)
    move(ekf, -15.0)
    ekf.covariance[3:6, 3:6] = np.diag([1.0, 20.0**2, 1.0])
    life.add_fix(0.1)
    assert life.update(True, ekf) is TrackStatus.ACQUIRING
    ekf.covariance[3:6, 3:6] = np.eye(3)
    assert life.update(True, ekf) is TrackStatus.TRACKING
    ekf.covariance[3:6, 3:6] = np.eye(3) * 30.0**2
    assert life.update(False, ekf) is TrackStatus.COASTING, "settled once, settled for this target"


def seen(life: TrackStateMachine, ekf: StationEkf, t_s: float, cameras: int) -> TrackStatus:
    """Bring a track through one epoch in which so many cameras' pixels were accepted."""
    for _ in range(cameras):
        life.add_pixel(t_s)
    if cameras > 1:
        life.add_fix(t_s)
    status = life.update(cameras > 1, ekf)
    life.set_status(t_s, status)
    return status


def test_after_a_while_without_a_pixel_one_pair_is_not_yet_a_track() -> None:
    life, ekf = started(found=False)
    track, coast = TrackStatus.TRACKING, TrackStatus.COASTING
    assert [seen(life, ekf, 0.1 * k, 2) for k in range(1, 4)] == [track] * 3
    assert [seen(life, ekf, 0.1 * k, 0) for k in range(4, 7)] == [coast] * 3
    assert seen(life, ekf, 0.7, 2) is track, "a short gap needs no proof"
    assert [seen(life, ekf, 0.1 * k, 0) for k in range(8, 16)] == [coast] * 8
    assert seen(life, ekf, 1.6, 2) is coast
    assert seen(life, ekf, 1.7, 0) is coast
    assert seen(life, ekf, 2.3, 2) is coast, "too long after the first to confirm it"
    assert seen(life, ekf, 2.4, 2) is track


def test_a_second_camera_that_returns_to_a_tracking_one_is_accepted_at_once() -> None:
    life, ekf = started(found=False)
    seen(life, ekf, 0.1, 2)
    for k in range(2, 40):
        assert seen(life, ekf, 0.1 * k, 1) is TrackStatus.COASTING
    assert seen(life, ekf, 4.0, 2) is TrackStatus.TRACKING


def test_pictures_once_a_second_are_confirmed_by_the_next() -> None:
    life, ekf = started(found=False)
    statuses = [seen(life, ekf, float(k), cameras) for k, cameras in enumerate([2, 2, 0, 2, 2, 2, 0, 2, 2])]
    track, coast = TrackStatus.TRACKING, TrackStatus.COASTING
    assert statuses == [track, track, coast, coast, track, track, coast, coast, track]


def test_time_alone_ends_an_unconfirmed_target() -> None:
    """Expected: after ``proof_s`` with too few fixes, after ``false_target_s`` with enough; never a given target."""
    life, _ = started(found=True)
    assert not life.confirmation.is_overdue(1.0)
    assert life.confirmation.is_overdue(1.001)
    for k in range(3):
        assert life.confirmation.is_overdue(1.001)
        life.add_fix(0.1 * k)
    assert not life.confirmation.is_overdue(4.0)
    assert life.confirmation.is_overdue(4.001)
    given, _ = started(found=False)
    assert not given.confirmation.is_overdue(60.0)


def test_unseen_is_counted_from_the_newest_pixel() -> None:
    life, _ = started(found=False)
    life.add_pixel(2.0)
    life.add_pixel(1.0)
    assert not life.is_unseen(10.0)
    assert life.is_unseen(10.001)


def stood(odds: float) -> tuple[TrackStateMachine, StationEkf]:
    """Return a target that was found without motion, and fixed for ten seconds."""
    life, ekf = started(found=True)
    at = ekf.kinematics_at(0.0).position_runway_m
    life.start(0.0, at, standing=True, odds=odds)
    for k in range(100):
        life.add_fix(k * 0.1)
        life.recognition.add("left", k * 0.1, odds)
    return life, ekf


def test_an_aircraft_that_is_recognised_may_stand_and_is_not_reported_before_it_moves() -> None:
    life, ekf = stood(4.0)
    recognised = life.recognition.is_recognised
    assert recognised
    assert not life.confirmation.is_false_track(10.0, ekf, recognised=recognised)
    assert not life.confirmation.is_overdue(10.0, recognised=recognised)
    assert life.update(True, ekf) is TrackStatus.ACQUIRING
    there = ekf.kinematics_at(0.0)
    ekf.start_target(there.position_runway_m, np.array([0.0, 5.0, 0.0]), there.covariance)
    assert life.update(True, ekf) is TrackStatus.TRACKING


def test_what_is_no_longer_recognised_may_not_stand() -> None:
    life, ekf = stood(4.0)
    for k in range(100, 140):
        life.recognition.add("left", k * 0.1, -6.0)
    assert not life.recognition.is_recognised
    assert life.confirmation.is_false_track(14.0, ekf, recognised=life.recognition.is_recognised)


def test_a_recognised_aircraft_that_stands_yields_to_what_moves() -> None:
    """Expected: at once to what is recognised, else after the time that a found target has to move, 4 s."""
    life, _ = stood(4.0)
    assert life.needs_search(9.9)
    assert life.yields_to(recognised=True, moving_s=0.6)
    assert not life.yields_to(recognised=True, moving_s=None)
    assert not life.yields_to(recognised=False, moving_s=3.9)
    assert life.yields_to(recognised=False, moving_s=4.1)


@pytest.mark.parametrize(("odds", "yields"), [(3.1, True), (2.9, False), (None, True)])
def test_a_recognised_thing_that_stands_yields_to_a_much_nearer_one(odds: float | None, yields: bool) -> None:
    """Expected: something on the horizon is left for an aircraft near by that has not moved far enough yet."""
    life, _ = stood(4.0)
    assert life.yields_to(recognised=True, moving_s=None, odds=odds, far_nearer=True) is yields
    assert not life.yields_to(recognised=True, moving_s=None, odds=odds, far_nearer=False)
    assert not life.yields_to(recognised=False, moving_s=None, odds=odds, far_nearer=True)


def test_what_moves_yields_to_what_moves_and_is_recognised_only() -> None:
    """Expected: parked aircraft and birds take no target over; a recognised one is not looked past."""
    for odds in (4.0, 0.5):
        life, ekf = stood(odds)
        move(ekf, -15.0)
        assert not life.confirmation.is_false_track(9.9, ekf)
        assert life.update(True, ekf) is TrackStatus.TRACKING
        assert life.needs_search(9.9) is (odds < 1.5)
        assert not life.yields_to(recognised=True, moving_s=None)
        assert not life.yields_to(recognised=False, moving_s=9.0)
        assert life.yields_to(recognised=True, moving_s=0.6) is (odds < 1.5)


def test_a_recognised_aircraft_yields_to_a_much_nearer_one_until_its_velocity_has_settled() -> None:
    """Expected: traffic behind the aircraft that lands gives way to it, and nothing that is reported does."""
    life, ekf = started(found=True)
    life.start(0.0, ekf.kinematics_at(0.0).position_runway_m, odds=4.0)
    life.recognition.add("left", 0.0, 4.0)
    life.add_fix(0.1)
    assert life.needs_search(0.2)
    assert life.yields_to(recognised=True, moving_s=0.6, far_nearer=True)
    assert not life.yields_to(recognised=True, moving_s=0.6, far_nearer=False)
    assert not life.yields_to(recognised=False, moving_s=0.6, far_nearer=True)
    assert not life.yields_to(recognised=True, moving_s=None, far_nearer=True)
    # a bird near the cameras, which the channel half believes
    assert life.yields_to(recognised=True, moving_s=0.6, odds=3.1, far_nearer=True)
    assert not life.yields_to(recognised=True, moving_s=0.6, odds=2.9, far_nearer=True)
    move(ekf, -15.0)
    assert life.update(True, ekf) is TrackStatus.TRACKING
    assert not life.needs_search(0.2)
    assert not life.yields_to(recognised=True, moving_s=0.6, far_nearer=True)


@pytest.mark.parametrize(("speed_m_s", "reported"), [(0.0, False), (4.9, False), (5.1, True)])
def test_a_found_target_is_reported_only_while_its_velocity_is_not_zero(speed_m_s: float, reported: bool) -> None:
    """Expected: five sigmas, of 1 m/s each."""
    life, ekf = started(found=True)
    life.start(0.0, ekf.kinematics_at(0.0).position_runway_m)
    life.add_fix(0.1)
    covariance = np.diag([0.01, 0.25, 0.01, 1.0, 1.0, 1.0])
    ekf.start_target(np.array([0.0, 200.0, 8.0]), np.array([0.0, speed_m_s, 0.0]), covariance)
    assert (life.update(True, ekf) is not TrackStatus.ACQUIRING) is reported


@pytest.mark.parametrize(
    ("odds", "other", "unseen_s", "likelier"),
    [
        (5.0, -5.6, 0.1, True),
        (5.0, 3.9, 0.1, True),
        (5.0, 4.1, 0.1, False),
        (5.0, None, 0.1, False),
        (-1.0, 3.0, 0.1, False),
        (5.0, -5.6, 0.6, False),
    ],
    ids=["a bird", "less likely", "as likely", "unknown", "a bird itself", "no camera sees it"],
)
def test_one_camera_that_knows_the_target_outweighs_two_that_see_something_else_move(
    odds: float, other: float | None, unseen_s: float, likelier: bool
) -> None:
    """A target that one camera has followed for 3 s is doubtful: expected not to yield to what is no aircraft."""
    life, ekf = stood(odds)
    move(ekf, -15.0)
    for k in range(100, 130):
        life.add_pixel(0.1 * k)
        life.recognition.add("left", 0.1 * k, odds)
    assert life.is_doubtful(12.9 + unseen_s)
    assert life.is_likelier_than(12.9 + unseen_s, other) is likelier


def test_a_target_that_is_corrected_stays_recognised_as_it_was() -> None:
    life, ekf = stood(4.0)
    move(ekf, -15.0)
    assert not life.confirmation.is_false_track(9.9, ekf)
    before = life.recognition.odds
    life.start(9.9, None, known=True)
    assert life.recognition.odds == before
    assert not life.yields_to(recognised=True, moving_s=0.6)
    life.start(9.9, None)
    assert life.recognition.odds is None


def test_what_stands_and_is_not_recognised_yields_to_each() -> None:
    life, _ = stood(0.5)
    assert life.yields_to(recognised=True, moving_s=None)
    assert life.yields_to(recognised=False, moving_s=0.6)


def test_an_aircraft_that_comes_to_stand_is_searched_past_and_no_longer_reported() -> None:
    """Expected: it is kept, and reported again when it moves on."""
    life, ekf = stood(4.0)
    move(ekf, -15.0)
    assert not life.confirmation.is_false_track(10.0, ekf, recognised=True)
    assert life.update(True, ekf) is TrackStatus.TRACKING
    there = ekf.kinematics_at(0.0)
    ekf.start_target(there.position_runway_m, np.zeros(3), there.covariance)
    for k in range(100, 200):
        life.add_fix(0.1 * k)
        life.recognition.add("left", 0.1 * k, 4.0)
        assert not life.confirmation.is_false_track(0.1 * k, ekf, recognised=True)
    assert life.confirmation.is_standing
    assert life.needs_search(19.9)
    assert life.update(True, ekf) is TrackStatus.ACQUIRING
    ekf.start_target(there.position_runway_m, np.array([0.0, 5.0, 0.0]), there.covariance)
    assert life.update(True, ekf) is TrackStatus.TRACKING


def test_the_report_of_what_moved_once_does_not_come_and_go() -> None:
    life, ekf = stood(4.0)
    there = ekf.kinematics_at(0.0)
    for speed in (5.0, 1.0):
        ekf.start_target(there.position_runway_m, np.array([0.0, speed, 0.0]), there.covariance)
        assert life.update(True, ekf) is TrackStatus.TRACKING


def test_a_target_that_no_learned_channel_has_seen_is_not_searched_for() -> None:
    life, _ = started(found=True)
    for k in range(100):
        life.add_fix(k * 0.1)
    assert not life.recognition.is_available
    assert not life.needs_search(9.9)


@pytest.mark.parametrize(
    ("height_m", "velocity_m_s", "recognised", "reported"),
    [
        (1.0, (8.0, -3.0, 0.0), False, False),
        (1.0, (8.0, -3.0, 0.0), True, True),
        (1.0, (3.0, -8.0, 0.0), False, True),
        (4.1, (8.0, -3.0, 0.0), False, False),
        (4.3, (8.0, -3.0, 0.0), False, True),
    ],
    ids=["crosses", "recognised", "rolls", "may be on the ground", "flies"],
)
def test_what_crosses_on_the_ground_is_reported_only_if_recognised(
    height_m: float, velocity_m_s: tuple[float, float, float], recognised: bool, reported: bool
) -> None:
    """Heights with a sigma of 0.1 m, about the 4 m that a lorry is high. One that was reported may cross afterwards."""
    life, ekf = started(found=True)
    covariance = np.diag([0.01] * 6)
    ekf.start_target(np.array([20.0, 200.0, height_m]), np.array(velocity_m_s), covariance)
    life.start(0.0, np.array([10.0, 200.0, height_m]), odds=3.0 if recognised else 0.5)
    life.add_fix(0.1)
    assert (life.update(True, ekf) is TrackStatus.TRACKING) is reported
    assert life.confirmation.has_crossed is not reported
    if reported:
        ekf.start_target(np.array([20.0, 200.0, 0.5]), np.array([8.0, 0.0, 0.0]), covariance)
        assert life.update(True, ekf) is TrackStatus.TRACKING
    else:
        ekf.start_target(np.array([30.0, 200.0, 9.0]), np.array(velocity_m_s), covariance)
        assert life.update(True, ekf) is TrackStatus.TRACKING, "it flies after all"


def test_an_estimate_that_ends_is_a_warning() -> None:
    life, _ = started(found=False)
    steps = [
        TrackStatus.TRACKING,
        TrackStatus.COASTING,
        TrackStatus.ACQUIRING,
        TrackStatus.TRACKING,
        TrackStatus.ACQUIRING,
    ]
    events = [life.set_status(0.1 * k, status) for k, status in enumerate(steps)]
    assert [each.level for each in events if each] == ["info", "warning", "warning", "info", "warning"]
