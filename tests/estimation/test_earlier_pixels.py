"""Pixels of a found target in earlier frames: its own, of one camera alone as well, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.earlier_pixels import EarlierPixels
from groundstation.estimation.tentative_track import motion_over
from groundstation.messages import INITIAL_PIXELS_S, InitialPixel, Kinematics
from tests.estimation.test_guided_search import candidate, geometries

VELOCITY_M_S = np.array([0.5, -18.0, -0.8])
FOUND_S, FOUND_M = 2.0, np.array([1.0, 220.0, 7.0])


def target(sigma_m: float = 0.3, sigma_m_s: float = 1.0) -> Kinematics:
    return Kinematics(
        position_runway_m=FOUND_M,
        velocity_runway_m_s=VELOCITY_M_S,
        covariance=np.diag([sigma_m**2] * 3 + [sigma_m_s**2] * 3),
    )


def seen(station: str, t_s: float, off_px: tuple[float, float] = (0.0, 0.0), odds: float = 3.0) -> CameraCandidate:
    """Return the candidate that the target is at a time, or one off by some pixels."""
    point = FOUND_M + VELOCITY_M_S * (t_s - FOUND_S)
    true = candidate(geometries()[station], station, point, 2.0, odds)
    return replace(true, t_s=t_s, pixel=true.pixel + off_px, sigma_px=1.0)


def earlier(frames: list[list[CameraCandidate]]) -> EarlierPixels:
    pixels = EarlierPixels(geometries(), InitiationConfig())
    for frame in frames:
        pixels.add(frame[0].station, frame[0].t_s, frame)
    return pixels


def test_what_one_camera_saw_before_is_the_target_s() -> None:
    frames = [[seen("left", t), seen("left", t, (90.0, -40.0))] for t in (1.2, 1.4, 1.6)]
    found = earlier(frames).of(FOUND_S, target(), ())
    assert [p.t_s for p in found] == [1.2, 1.4, 1.6]
    for p, (own, _) in zip(found, frames, strict=True):
        assert (p.station, p.u_px, p.v_px) == ("left", *own.pixel)
        assert p.sigma_px == pytest.approx(np.hypot(1.0, InitiationConfig().candidate_sigma_px))


@pytest.mark.parametrize(
    "frame",
    [
        [seen("left", 1.6, (90.0, -40.0))],
        [seen("left", 1.6, odds=-0.5)],
        [seen("left", FOUND_S - INITIAL_PIXELS_S - 0.1)],
        [seen("left", FOUND_S + 0.1)],
    ],
    ids=["elsewhere", "no aircraft", "too old", "later"],
)
def test_others_are_not(frame: list[CameraCandidate]) -> None:
    assert earlier([frame]).of(FOUND_S, target(), ()) == ()


def test_the_pixels_of_fixes_stay_where_the_target_explains_no_other() -> None:
    """Its tentative track took something else in one frame, and a candidate without odds in another."""
    fixes = tuple(InitialPixel(t_s=t, station="left", u_px=1.0, v_px=2.0, sigma_px=1.0) for t in (1.4, 1.6, -3.5))
    own = seen("left", 1.6)
    found = earlier([[own], [seen("right", 1.6)]]).of(FOUND_S, target(), fixes)
    assert {(p.t_s, p.station): p.u_px for p in found} == {
        (1.4, "left"): 1.0,
        (1.6, "left"): own.pixel[0],
        (1.6, "right"): seen("right", 1.6).pixel[0],
    }


def test_of_two_that_are_as_near_the_likelier_aircraft_is_taken() -> None:
    frame = [seen("left", 1.6, (6.0, 0.0), odds=0.5), seen("left", 1.6, (-6.5, 0.0), odds=4.0)]
    (pixel,) = earlier([frame]).of(FOUND_S, target(), ())
    assert pixel.u_px == frame[1].pixel[0]


def test_where_the_target_could_be_anywhere_none_is_taken() -> None:
    """Carried back by three seconds with 40 m/s of doubt it is no likelier at the candidate than other things are."""
    assert earlier([[seen("left", -1.0)]]).of(FOUND_S, target(sigma_m_s=0.2), ())
    crowd = [seen("left", -1.0), *(seen("left", -1.0, (40.0 * k, 300.0)) for k in range(-5, 6))]
    assert earlier([crowd]).of(FOUND_S, target(sigma_m_s=40.0), ()) == ()


def test_an_aircraft_that_has_begun_to_move_stood_before() -> None:
    """Expected: at its speed now, 6 m/s, it would have been 8 m farther away where it stood."""
    start_s, acceleration = 0.6, 4.3

    def at(t_s: float) -> CameraCandidate:
        y = FOUND_M[1] - 0.5 * acceleration * max(t_s - start_s, 0.0) ** 2
        true = candidate(geometries()["left"], "left", np.array([FOUND_M[0], y, 0.3]), 2.0, 3.0)
        return replace(true, t_s=t_s, sigma_px=1.0)

    moved = Kinematics(
        position_runway_m=np.array([FOUND_M[0], FOUND_M[1] - 0.5 * acceleration * (FOUND_S - start_s) ** 2, 0.3]),
        velocity_runway_m_s=np.array([0.0, -acceleration * (FOUND_S - start_s), 0.0]),
        covariance=np.diag([0.3**2] * 3 + [0.6**2] * 3),
    )
    times = np.round(np.arange(-2.0, 2.0, 0.1), 3)
    found = earlier([[at(float(t_s))] for t_s in times]).of(FOUND_S, moved, ())
    assert [p.t_s for p in found] == times.tolist()


def test_the_state_is_followed_back_within_its_covariance(rng: np.random.Generator) -> None:
    """Expected: of 300 targets of the filter's own model 1 % of the pixels are beyond the gate, and each is near."""
    psd, steps, lost, count = InitiationConfig().acceleration_psd_m2_s3, 20, 0, 0
    F, Q = motion_over(0.1, psd)
    root = np.linalg.cholesky(Q)
    start = np.diag([0.3, 0.3, 0.3, 1.0, 1.0, 1.0])
    for _ in range(300):
        state = np.concatenate([FOUND_M, VELOCITY_M_S])
        known = state + start @ rng.normal(size=6)
        frames = []
        for k in range(steps):
            state = np.linalg.solve(F, state - root @ rng.normal(size=6))
            true = candidate(geometries()["left"], "left", state[:3], 2.0, 3.0)
            sigma = np.hypot(1.0, InitiationConfig().candidate_sigma_px)
            shown = replace(true, t_s=FOUND_S - 0.1 * (k + 1), sigma_px=1.0, angle_sigma_rad=0.0)
            frames.append([replace(shown, pixel=true.pixel + sigma * rng.normal(size=2))])
        target = Kinematics(position_runway_m=known[:3], velocity_runway_m_s=known[3:], covariance=start**2)
        lost += steps - len(earlier(frames[::-1]).of(FOUND_S, target, ()))
        count += steps
    # binomial, 1 % each; R is stated larger than it is for the update, so that fewer are beyond
    assert lost <= 0.01 * count + 4.0 * np.sqrt(0.01 * count)
