"""Turning a head after a target: never losing it through its own lag, never beyond what the head can do."""

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_z, wxyz_from_matrix
from groundstation.messages import Kinematics, PtuSample, Purpose
from groundstation.pointing.head_limits import AxisLimits, HeadLimits
from groundstation.pointing.pointing_law import HeadController, PointingConfig
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from tests.stereo_rig import make_rig

DEG = math.radians(1.0)
LIMITS = AxisLimits(low_rad=-60 * DEG, high_rad=60 * DEG, fastest_rad_s=50 * DEG, acceleration_rad_s2=60 * DEG)
HEAD = HeadLimits(pan=LIMITS, tilt=LIMITS)


class Head:
    """A head that takes rates after a latency and reaches them at its own acceleration."""

    def __init__(self, pan: float, tilt: float, latency_s: float, limits: AxisLimits) -> None:
        self.angles = np.array([pan, tilt])
        self.rates = np.zeros(2)
        self._limits = limits
        self._latency_s = latency_s
        self._waiting: deque[tuple[float, FloatArray]] = deque()
        self._wanted = np.zeros(2)
        self.fastest = self.steepest = 0.0

    def tell(self, t_s: float, rates: FloatArray) -> None:
        self._waiting.append((t_s + self._latency_s, rates))

    def run(self, t_s: float, dt_s: float) -> None:
        while self._waiting and self._waiting[0][0] <= t_s:
            self._wanted = self._waiting.popleft()[1]
        step = self._limits.acceleration_rad_s2 * dt_s
        self.rates = self.rates + np.clip(self._wanted - self.rates, -step, step)
        self.angles = self.angles + self.rates * dt_s


def landing(t_s: float) -> FloatArray:
    """20 m/s down a 3° glide from 500 m, level from where it would touch."""
    y = 500.0 - 20.0 * t_s
    return np.array([1.5 * math.sin(0.4 * t_s), y, max(1.0, (y - 131.0) * math.tan(3 * DEG))])


def flown(latency_s: float, assumed_s: float, seconds: float = 22.0) -> tuple[list[float], Head]:
    """Return how far off the aim was, in rad, over a landing, with readings at 40 Hz and commands at 25 Hz."""
    geometry = make_rig().stations[0].geometry()
    controller = HeadController(geometry, HEAD, PointingConfig(latency_s=assumed_s))
    begin = aim_at(geometry, landing(0.0))
    assert begin is not None
    head = Head(begin.pan_rad + 2 * DEG, begin.tilt_rad, latency_s, LIMITS)
    off, commanded = [], np.zeros(2)
    for k in range(round(seconds * 1000)):
        t = 0.001 * k
        if k % 25 == 0:
            # read 10 ms ago
            controller.read(PtuSample(t_s=t - 0.01, station="left", pan_rad=head.angles[0], tilt_rad=head.angles[1]))
        if k % 40 == 0:
            command = controller.follow(t, landing)
            new = np.array([command.pan_rate_rad_s, command.tilt_rate_rad_s])
            head.fastest = max(head.fastest, float(np.abs(new).max()))
            head.steepest = max(head.steepest, float(np.abs(new - commanded).max()) / 0.04)
            commanded = new
            head.tell(t, new)
        head.run(t, 0.001)
        aim = aim_at(geometry, landing(t))
        assert aim is not None
        off.append(float(np.abs(head.angles - [aim.pan_rad, aim.tilt_rad]).max()))
    return off, head


@pytest.mark.parametrize(
    ("roll_deg", "half_px"), [(0, (640, 480)), (90, (480, 640)), (180, (640, 480)), (-90, (480, 640))]
)
def test_a_search_takes_the_view_of_a_camera_on_its_side_as_it_is(roll_deg: int, half_px: tuple[int, int]) -> None:
    """Expected: the sweep reaches as far to the side as leaves 90 % of half a view to the sector's border."""
    rig = make_rig()
    for_all = [
        replace(
            s,
            head_from_camera_wxyz=wxyz_from_matrix(
                matrix_from_wxyz(s.head_from_camera_wxyz) @ rotation_z(math.radians(roll_deg))
            ),
        )
        for s in rig.stations
    ]
    config = SearchConfig(azimuth_deg=(-20.0, 20.0), elevation_deg=(0.0, 20.0))
    pattern = SearchPattern({s.name: s.geometry() for s in for_all}, config)
    points = np.array([pattern.point(t) for t in np.arange(0.0, 600.0, 0.02)])
    lens = rig.stations[0].lens
    assert lens.image_size_px == (1280, 960)
    across, up = (np.ptp(points[:, k]) / 2.0 / 500.0 for k in (0, 2))
    wide, high = math.tan(20 * DEG), 0.5 * math.tan(20 * DEG)
    assert across == pytest.approx(wide - 0.9 * half_px[0] / lens.focal_px[0], abs=1e-3)
    assert up == pytest.approx(high - 0.9 * half_px[1] / lens.focal_px[1], abs=1e-3)


def test_a_landing_stays_in_the_middle_of_the_view() -> None:
    off, head = flown(latency_s=0.03, assumed_s=0.03)
    # two degrees at the start are made good within two seconds
    assert max(off[2000:]) < 0.1 * DEG
    assert head.fastest <= LIMITS.fastest_rad_s
    assert head.steepest <= LIMITS.acceleration_rad_s2 * 1.001


@pytest.mark.parametrize("assumed_s", [0.0, 0.1])
def test_a_wrong_latency_costs_a_fraction_of_a_view(assumed_s: float) -> None:
    off, _ = flown(latency_s=0.05, assumed_s=assumed_s)
    assert max(off[2000:]) < 0.5 * DEG


@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_no_command_leads_beyond_a_limit(pan: float, tilt: float, goal_pan: float, goal_tilt: float) -> None:
    geometry = make_rig().stations[0].geometry()
    limits = AxisLimits(low_rad=-1.0, high_rad=1.0, fastest_rad_s=0.8, acceleration_rad_s2=1.0, slowest_rad_s=0.01)
    controller = HeadController(geometry, HeadLimits(pan=limits, tilt=limits), PointingConfig(margin_deg=1.0))
    head = Head(np.clip(pan, -0.95, 0.95), np.clip(tilt, -0.95, 0.95), 0.0, limits)
    for k in range(200):
        t = 0.02 * k
        controller.read(PtuSample(t_s=t, station="left", pan_rad=head.angles[0], tilt_rad=head.angles[1]))
        command = controller.go_to(t, goal_pan, goal_tilt, Purpose.PARK)
        rates = np.array([command.pan_rate_rad_s, command.tilt_rate_rad_s])
        assert np.all((rates == 0.0) | (np.abs(rates) >= 0.01))
        assert np.all(np.abs(rates) <= 0.8)
        head.tell(t, rates)
        for _ in range(20):
            head.run(t, 0.001)
        assert np.all(np.abs(head.angles) <= 1.0)
    goal = np.clip([goal_pan, goal_tilt], -1.0 + DEG, 1.0 - DEG)
    # a head that cannot creep stops within what its slowest speed does between two commands
    assert np.all(np.abs(head.angles - goal) < 0.3 * DEG)


@given(at=st.floats(-1.0, 1.0), goal=st.floats(-3.0, 3.0), acceleration=st.floats(0.5, 10.0))
def test_no_rate_is_commanded_that_a_driver_refuses(at: float, goal: float, acceleration: float) -> None:
    """Expected: by the driver's own rule, a stop command 0.1 s later would still stop the head before its limit."""
    limits = AxisLimits(low_rad=-1.0, high_rad=1.0, fastest_rad_s=2.0, acceleration_rad_s2=acceleration)
    controller = HeadController(
        make_rig().stations[0].geometry(), HeadLimits(pan=limits, tilt=limits), PointingConfig()
    )
    for k in range(40):
        # held at its position while the command grows to its maximum there
        controller.read(PtuSample(t_s=0.03 * k, station="left", pan_rad=at, tilt_rad=at))
        rate = controller.go_to(0.03 * k, goal, goal, Purpose.TRACK).tilt_rate_rad_s
        reach = at + rate * abs(rate) / (2.0 * acceleration) + 0.1 * rate
        assert reach < 1.0 if rate > 0 else reach > -1.0 if rate < 0 else True


def test_a_unit_whose_zero_is_aside_follows_through_its_back() -> None:
    """Expected: with readings from −78° to 258° a target that comes to 190° is followed there, not from −170° on."""
    geometry = make_rig().stations[0].geometry()
    pan = AxisLimits(low_rad=-78 * DEG, high_rad=258 * DEG, fastest_rad_s=60 * DEG, acceleration_rad_s2=60 * DEG)
    controller = HeadController(geometry, HeadLimits(pan=pan, tilt=LIMITS), PointingConfig())
    eye = geometry.packed[9:12]

    def target(t_s: float) -> FloatArray:
        at = (172.0 + 5.0 * t_s) * DEG
        return np.asarray(eye + 100.0 * np.array([-math.sin(at), math.cos(at), 0.2]))

    head = Head(172.0 * DEG, 11.0 * DEG, 0.02, pan)
    for k in range(100):
        t = 0.04 * k
        controller.read(PtuSample(t_s=t, station="left", pan_rad=head.angles[0], tilt_rad=head.angles[1]))
        command = controller.follow(t, target)
        head.tell(t, np.array([command.pan_rate_rad_s, command.tilt_rate_rad_s]))
        for n in range(40):
            head.run(t + 0.001 * n, 0.001)
    assert head.angles[0] == pytest.approx(192.0 * DEG, abs=0.5 * DEG)


def test_without_readings_the_head_stands() -> None:
    geometry = make_rig().stations[0].geometry()
    controller = HeadController(geometry, HEAD, PointingConfig(stale_s=0.5))
    assert controller.follow(0.0, landing).pan_rate_rad_s == 0.0
    controller.read(PtuSample(t_s=0.0, station="left", pan_rad=0.3, tilt_rad=0.0))
    assert controller.follow(0.1, landing).pan_rate_rad_s != 0.0
    assert controller.follow(0.7, landing).pan_rate_rad_s == 0.0


def test_a_target_that_is_gone_stops_the_head() -> None:
    geometry = make_rig().stations[0].geometry()
    controller = HeadController(geometry, HEAD, PointingConfig())
    controller.read(PtuSample(t_s=0.0, station="left", pan_rad=0.1, tilt_rad=0.0))
    command = controller.follow(0.01, lambda _: None)
    assert command.purpose is Purpose.HOLD
    assert (command.pan_rate_rad_s, command.tilt_rate_rad_s) == (0.0, 0.0)


def test_the_sector_is_swept_whole_and_slowly() -> None:
    config = SearchConfig(azimuth_deg=(-25.0, 25.0), elevation_deg=(0.0, 20.0), dwell_s=1.0)
    stations = {s.name: s.geometry() for s in make_rig().stations}
    pattern = SearchPattern(stations, config)
    times = np.arange(0.0, 300.0, 0.05)
    points = np.array([pattern.point(t) for t in times])
    geometry = next(iter(stations.values()))
    half = 0.5 * np.array(geometry.image_size_px) / geometry.lens.focal_px
    looked = points[:, [0, 2]] / points[:, 1:2]
    speed = np.abs(np.diff(looked, axis=0)).max(axis=0) / 0.05
    assert np.all(speed <= 2.0 * half / config.dwell_s * 1.01)
    for azimuth in np.tan(np.radians(np.linspace(-25, 25, 11))):
        for elevation in np.tan(np.radians(np.linspace(0, 20, 9))):
            near = np.abs(looked - [azimuth, elevation]) <= half
            assert near.all(axis=1).any(), (azimuth, elevation)


def test_after_a_loss_it_points_at_the_predicted_position() -> None:
    stations = {s.name: s.geometry() for s in make_rig().stations}
    pattern = SearchPattern(stations, SearchConfig(lost_s=10.0))
    last = Kinematics(
        position_runway_m=np.array([2.0, 300.0, 12.0]),
        velocity_runway_m_s=np.array([0.0, -20.0, -1.0]),
        covariance=np.diag([0.01, 1.0, 0.01, 0.01, 0.2, 0.01]),
    )
    pattern.seen(5.0, last)
    np.testing.assert_allclose(pattern.point(5.0), last.position_runway_m, atol=0.1)
    np.testing.assert_allclose(pattern.point(7.0), [2.0, 260.0, 10.0], atol=4.0)
    assert pattern.after_loss(15.0)
    assert not pattern.after_loss(15.1)
    # wider as time goes by, and never below the runway
    far = np.array([pattern.point(t) for t in np.arange(12.0, 15.0, 0.02)])
    assert np.ptp(far[:, 0]) > 1.0
    assert far[:, 2].min() >= 0.0


@pytest.mark.parametrize("lost_s", [0.0, 100.0, 1000.0, 1.7e9])
def test_after_a_loss_each_place_stays_in_view_whatever_the_clock_shows(lost_s: float) -> None:
    """Expected: no place leaves the view faster than in a dwell, and so the aim is nowhere near a head's fastest.

    A sweep whose size grew with the time was taken where the session's age put it: 1000 s after its begin by
    2000 degrees a second.
    """
    config = SearchConfig(lost_s=60.0, acceleration_psd_m2_s3=1.0)
    stations = {s.name: s.geometry() for s in make_rig().stations}
    pattern = SearchPattern(stations, config)
    geometry = next(iter(stations.values()))
    half = 0.5 * np.array(geometry.image_size_px) / geometry.lens.focal_px
    last = Kinematics(
        position_runway_m=np.array([0.0, 400.0, 25.0]),
        velocity_runway_m_s=np.array([0.0, -4.0, -0.2]),
        covariance=np.diag([0.1, 4.0, 0.1, 0.3, 0.3, 0.3]),
    )
    pattern.seen(lost_s, last)
    after = np.arange(0.0, config.lost_s, 0.02)
    predicted = last.position_runway_m + after[:, None] * last.velocity_runway_m_s
    aims = np.array([pattern.point(lost_s + t) for t in after])
    apart = (aims - predicted)[:, [0, 2]] / predicted[:, 1:2]
    assert np.all(np.abs(np.diff(apart, axis=0)) / 0.02 <= 2.0 * half / config.dwell_s * 1.02)
    assert aims[:, 2].min() >= 0.0
    # it begins where the target must be, and goes round that
    assert np.abs(apart[after < 1.5]).max() < 0.5 * half.min()
    assert apart[:, 0].min() < -half[0]
    assert apart[:, 0].max() > half[0]
    assert apart[:, 1].max() > half[1]


def test_bad_tuning_is_refused() -> None:
    with pytest.raises(ValueError, match="gain_per_s"):
        PointingConfig(gain_per_s=0.0)
    with pytest.raises(ValueError, match="rate_share"):
        PointingConfig(rate_share=1.5)
    with pytest.raises(ValueError, match="low, high"):
        SearchConfig(azimuth_deg=(5.0, -5.0))
    with pytest.raises(ValueError, match="dwell_s"):
        SearchConfig(dwell_s=0.0)
