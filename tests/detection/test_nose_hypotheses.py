"""Where a nose may be: the map is right, or the silhouette and the direction of flight say what it cannot."""

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.channel_candidate import ChannelCandidate
from groundstation.detection.channel_window import WINDOW_PX
from groundstation.detection.learned_channel import ChannelMaps
from groundstation.detection.nose_hypotheses import ExpectedHeading, is_known, likeliest, nose_hypotheses, nose_in

# a fuselage 40 px long, seen from the side, and its ends
BOX = Box(44, 44, 84, 51)
LEFT, RIGHT = np.array([46.0, 47.0]), np.array([81.0, 47.0])


def fuselage() -> ChannelCandidate:
    mask = np.zeros(WINDOW_PX[::-1], np.bool_)
    mask[BOX.y0 : BOX.y1, BOX.x0 : BOX.x1] = True
    return ChannelCandidate(mask=mask, odds=4.0, centre=np.array([63.5, 47.0]), box=BOX)


def shown(at: np.ndarray, sigma_px: float = 1.5) -> ChannelMaps:
    """A map whose nose is at a place (2,)."""
    u, v = np.meshgrid(np.arange(WINDOW_PX[0]), np.arange(WINDOW_PX[1]))
    nose = np.exp(-0.5 * ((u - at[0]) ** 2 + (v - at[1]) ** 2) / sigma_px**2)
    return ChannelMaps(aircraft=np.zeros(WINDOW_PX[::-1], np.float32), nose=(nose / nose.sum()).astype(np.float32))


def heading(sigma_rad: float = 0.05) -> ExpectedHeading:
    """To the right, across the line of sight."""
    return ExpectedHeading(ahead_px=np.array([40.0, 0.0]), span_px=40.0, sigma_rad=sigma_rad)


def test_of_a_map_at_the_wrong_end_the_direction_of_flight_is_believed() -> None:
    """The point is in the half ahead, and its covariance contains the end that the map shows."""
    found = nose_hypotheses(shown(LEFT), fuselage(), heading())
    point, covariance = likeliest(found)
    assert point[0] > 70.0
    assert found[0].probability > 0.6
    off = LEFT - point
    assert off @ np.linalg.solve(covariance, off) < 9.2
    off = RIGHT - point
    assert off @ np.linalg.solve(covariance, off) < 2.0


def test_a_map_that_agrees_is_believed_more_than_one_that_does_not() -> None:
    agreed, not_so = (nose_hypotheses(shown(at), fuselage(), heading()) for at in (RIGHT, LEFT))
    assert agreed[0].probability > 0.97
    assert np.hypot(*(likeliest(agreed)[0] - RIGHT)) < 1.0
    assert np.trace(likeliest(agreed)[1]) < 0.05 * np.trace(likeliest(not_so)[1])


def test_a_direction_that_is_less_certain_says_less() -> None:
    """In a view along the line of flight, by the spread across it; beyond half a radian it says nothing."""
    ahead = np.array([2.0, 0.0])
    spreads = []
    for sigma_rad in (0.05, 0.45):
        found = nose_hypotheses(
            shown(LEFT), fuselage(), ExpectedHeading(ahead_px=ahead, span_px=40.0, sigma_rad=sigma_rad)
        )
        spreads.append(float(likeliest(found)[1][0, 0]))
    assert spreads[1] > 1.5 * spreads[0]
    assert is_known(0.45)
    assert not is_known(0.6)


def test_where_the_map_shows_nothing_outline_and_flight_are_left() -> None:
    empty = ChannelMaps(aircraft=np.zeros(WINDOW_PX[::-1], np.float32), nose=np.zeros(WINDOW_PX[::-1], np.float32))
    (ahead,) = nose_hypotheses(empty, fuselage(), heading())
    assert ahead.pixel[0] > 72.0
    assert ahead.covariance_px2[0, 0] < 0.6 * nose_in(empty, fuselage())[1][0, 0]


def test_hypotheses_are_probabilities_with_covariances(rng: np.random.Generator) -> None:
    for _ in range(40):
        nose = rng.random(WINDOW_PX[::-1]).astype(np.float32) ** 20
        maps = ChannelMaps(aircraft=np.zeros_like(nose), nose=nose / nose.sum() * np.float32(rng.random()))
        ahead = rng.normal(0.0, 30.0, 2)
        expected = ExpectedHeading(ahead_px=ahead, span_px=50.0, sigma_rad=float(rng.random()))
        found = nose_hypotheses(maps, fuselage(), expected)
        assert sum(h.probability for h in found) == pytest.approx(1.0)
        assert [h.probability for h in found] == sorted((h.probability for h in found), reverse=True)
        for each in found:
            assert np.all(np.linalg.eigvalsh(each.covariance_px2) > 0.05)
            assert BOX.x0 - 10 <= each.pixel[0] <= BOX.x1 + 10


def test_a_point_ahead_of_the_silhouette_is_less_likely() -> None:
    """Expected: a vague map and the direction of flight together lead no further beyond the outline than the map."""
    vague = shown(np.array([83.0, 47.0]), sigma_px=5.0)
    straight_ahead = ExpectedHeading(ahead_px=np.array([70.0, 0.0]), span_px=70.0, sigma_rad=0.05)
    first = nose_hypotheses(vague, fuselage(), straight_ahead)[0]
    # the outline ends at 83.5 px, the direction has the nose at 91.5 ± 10.5
    assert first.pixel[0] < 83.5
    # a nose that the level set has missed is still found
    missed = nose_hypotheses(shown(np.array([91.0, 47.0])), fuselage(), straight_ahead)
    assert abs(max(missed, key=lambda each: each.pixel[0]).pixel[0] - 91.0) < 1.0
