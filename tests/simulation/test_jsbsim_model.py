"""A real flight's log as a trajectory that lands on the runway."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import ScenarioError
from groundstation.session.flight_log import load_flight_log
from groundstation.simulation.logged_flight import trajectory_from_log

TOUCHDOWN_S = 613.5


def made_up_log(rng: np.random.Generator, heading_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """A descent at 15 m/s along a compass heading, with 3 cm of noise, that passes z = 0 at t = 60 s."""
    t = np.arange(0.0, 62.0, 0.04)
    heading = np.radians(heading_deg)
    along = 15.0 * (t - 60.0)
    up = np.maximum(0.8 * (60.0 - t), 0.0)
    track = np.column_stack([along * np.sin(heading) + 40.0, along * np.cos(heading) - 7.0, up + 3.0])
    return t, track + rng.normal(0, 0.03, track.shape)


@pytest.mark.parametrize("heading_deg", [0.0, 77.0, 180.0, 300.0])
def test_whatever_its_heading_it_lands_along_the_runway(rng: np.random.Generator, heading_deg: float) -> None:
    t, enu = made_up_log(rng, heading_deg)
    landing = trajectory_from_log(t, enu, touchdown_s=60.0, before_s=30.0, touchdown_y_m=80.0)
    assert landing.span_s == pytest.approx((0.0, 30.0))
    assert landing.position(np.array([30.0]))[0] == pytest.approx([0.0, 80.0, 0.3], abs=1e-9)
    moments = np.linspace(0.0, 29.0, 50)
    assert landing.velocity(moments) == pytest.approx(np.tile([0.0, -15.0, -0.8], (50, 1)), abs=0.15)
    straight = np.column_stack([0 * moments, 80.0 + 15.0 * (30.0 - moments), 0.3 + 0.8 * (30.0 - moments)])
    assert landing.position(moments) == pytest.approx(straight, abs=0.15)


def test_a_log_that_does_not_cover_the_landing_is_refused(rng: np.random.Generator) -> None:
    t, enu = made_up_log(rng, 0.0)
    with pytest.raises(ScenarioError, match=r"samples from 50 to 90 s of a log from 0 to 61\.96 s"):
        trajectory_from_log(t, enu, touchdown_s=90.0)
    with pytest.raises(ScenarioError, match="at least 1 m/s over ground"):
        trajectory_from_log(t, np.zeros_like(enu), touchdown_s=50.0)
    with pytest.raises(ScenarioError, match=r"position_enu_m: got shape"):
        trajectory_from_log(t, enu[:, :2], touchdown_s=50.0)


# the autopilot's filtered position at 25 Hz, and the receiver's own at 5 Hz
@pytest.mark.parametrize(("name", "sigma_m"), [("bin_parser_POS.csv", 0.03), ("bin_parser_GPS.csv", 0.2)])
def test_the_real_log(shared_data: Path, name: str, sigma_m: float) -> None:
    """Its last ten seconds: 12 m/s over ground, along −y, down to the runway; the log's noise is smoothed away."""
    path = shared_data / "fixedwing-gps-log" / name
    if not path.is_file():
        pytest.skip(f"no {path}")
    log = load_flight_log(path)
    landing = trajectory_from_log(log.t_s, log.position_enu_m, touchdown_s=TOUCHDOWN_S, before_s=14.0, sigma_m=sigma_m)
    t = np.linspace(8.0, 13.0, 40)
    p, v = landing.position(t), landing.velocity(t)
    assert 9.0 < np.hypot(v[:, 0], v[:, 1]).mean() < 15.0
    assert v[:, 1].max() < -5.0
    assert np.abs(p[:, 0]).max() < 3.0
    assert np.all(p[:, 2] < 15.0)
    assert np.abs(np.diff(landing.velocity(np.arange(0.0, 14.0, 0.1)), axis=0)).max() < 2.5, "at most 25 m/s²: no jumps"
