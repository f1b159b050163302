"""Existence probability after missed detections, and its effects on a track."""

import numpy as np
import pytest

from groundstation.estimation.config import EstimationConfig
from groundstation.tracking.existence_probability import ExistenceProbability
from groundstation.tracking.track_state_machine import TrackStateMachine
from tests.tracking.test_track_state_machine import started

STATIONS = ("left", "right")
# an innovation of a target that is well known
SHARP = (np.zeros(2), np.eye(2))


def seen(existence: ExistenceProbability, from_s: float = 0.0, to_s: float = 5.0, share: float = 1.0) -> None:
    rng = np.random.default_rng(1)
    for t in np.arange(from_s, to_s, 0.04):
        for name in STATIONS:
            if rng.random() < share:
                existence.hit(name, t, *SHARP)
            else:
                existence.miss(name, t, 1.0)


def time_to(existence: ExistenceProbability, below: float, in_view: float, from_s: float = 5.0) -> float | None:
    """Time of missed detections in both cameras, s; None if 8 s are not enough."""
    for t in np.arange(from_s, from_s + 8.0, 0.04):
        for name in STATIONS:
            existence.miss(name, t, in_view)
        if existence.probability < below:
            return float(t - from_s)
    return None


def test_one_frame_follows_bayes() -> None:
    """A missed detection a whole memory after the last: odds × (1 − P_D p_v)."""
    existence = ExistenceProbability(1.0)
    existence.start()
    existence.hit("left", 0.0, *SHARP)
    before = existence.probability / (1.0 - existence.probability)
    share = existence.miss("left", 1.0, 0.5)
    after = existence.probability / (1.0 - existence.probability)
    assert 0.75 < share < 0.95
    assert after / before == pytest.approx(1.0 - 0.5 * share)


def odds_after_a_hit(residual_px: float, sigma_px: float) -> float:
    existence = ExistenceProbability(1.0)
    existence.start()
    before = existence.probability / (1.0 - existence.probability)
    existence.hit("left", 0.0, np.array([residual_px, 0.0]), sigma_px**2 * np.eye(2))
    return existence.probability / (1.0 - existence.probability) / before


@pytest.mark.parametrize(("width_px", "rises"), [(300.0, True), (60.0, False)])
def test_a_large_target_is_not_refuted_by_where_its_nose_may_be(width_px: float, rises: bool) -> None:
    """Expected: pixels exactly where predicted, of a cut silhouette 300 px wide, with the sigma that this costs."""
    existence = ExistenceProbability(1.0)
    existence.start()
    before = existence.probability
    for k in range(10):
        existence.hit("left", 0.1 * k, np.zeros(2), np.diag([100.0**2, 80.0**2]), width_px)
    assert (existence.probability > before) == rises
    assert (existence.probability > 0.99) == rises


def test_a_pixel_has_less_weight_for_an_uncertain_prediction() -> None:
    """Where clutter is as likely in the gate as the target, a pixel is no information; far out it lowers the odds."""
    assert odds_after_a_hit(0.0, 1.0) == odds_after_a_hit(3.0, 1.5) == pytest.approx(20.0)
    # density of the target 1 / (2π σ²) = λ = 3·10⁻⁵
    even = (1.0 / (2.0 * np.pi * 3e-5)) ** 0.5
    assert odds_after_a_hit(0.0, even) == pytest.approx(1.0, abs=0.01)
    assert odds_after_a_hit(0.0, 30.0) > 3.0
    assert odds_after_a_hit(0.0, 200.0) < 0.5
    assert odds_after_a_hit(3.0 * even, even) < 0.3


def test_where_it_would_have_been_seen_belief_falls_in_seconds() -> None:
    """Seen all the time, then not at all: doubted within 2.5 s, lost in 3 to 6 s, before the 8 s of
    ``lost_after_s``; where it is seldom seen, or hardly in view, the time decides as before."""
    c = EstimationConfig()
    well = ExistenceProbability(c.miss_memory_s)
    seen(well)
    doubted = time_to(well, c.doubtful_existence, 1.0)
    assert doubted is not None
    assert doubted < 2.5
    lost = time_to(well, c.lost_existence, 1.0, 5.0 + doubted)
    assert lost is not None
    assert 3.0 < doubted + lost < 6.0
    border = ExistenceProbability(c.miss_memory_s)
    seen(border)
    assert time_to(border, c.lost_existence, 0.1) is None


def test_frame_rate_does_not_matter() -> None:
    out = []
    for step in (0.02, 0.1):
        existence = ExistenceProbability(1.0)
        existence.start()
        existence.hit("left", 0.0, *SHARP)
        for t in np.arange(step, 1.0 + step / 2, step):
            existence.miss("left", float(t), 0.5)
        out.append(existence.probability)
    assert out[0] == pytest.approx(out[1], rel=0.02)


def test_a_gap_is_survived() -> None:
    """A second in which neither camera finds it, and then it is found: belief is back at once."""
    existence = ExistenceProbability(1.0)
    seen(existence)
    assert time_to(existence, 0.5, 1.0, 5.0) is not None
    for k in range(3):
        existence.hit("left", 6.5 + 0.04 * k, *SHARP)
    assert existence.probability > 0.9


def test_it_drives_loss_and_search() -> None:
    life, ekf = started(found=False)
    for name in STATIONS:
        ekf.set_angles(name, (0.0, 0.03), (0.0, 0.0), 1e-5)
    assert not life.needs_search(0.5)
    assert not life.is_lost(0.5, ekf, STATIONS)
    seen(life.existence)
    assert isinstance(life, TrackStateMachine)
    time_to(life.existence, 0.4, 1.0)
    assert life.needs_search(0.5)
    time_to(life.existence, 1e-5, 1.0, 20.0)
    assert life.is_lost(0.5, ekf, STATIONS)
    life.start(20.0, None)
    assert not life.is_lost(20.5, ekf, STATIONS)


def test_a_late_picture_does_not_lengthen_the_next_interval() -> None:
    shares = []
    for late in (False, True):
        existence = ExistenceProbability(1.0)
        existence.start()
        seen(existence)
        if late:
            existence.hit("left", 4.6, *SHARP)
        shares.append(existence.miss("left", 5.05, 1.0))
    assert shares[1] == pytest.approx(shares[0], rel=0.05)
