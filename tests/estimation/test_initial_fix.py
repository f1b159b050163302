"""Fixes at one place: the likeliest counts, with the pixels of the other cameras that agree with it."""

from dataclasses import replace

import numpy as np

from groundstation.estimation.initial_fix import Fix, without_false_pairs, without_lesser
from groundstation.messages import InitialPixel


def pixel(station: str, u_px: float = 10.0) -> InitialPixel:
    return InitialPixel(t_s=0.0, station=station, u_px=u_px, v_px=20.0, sigma_px=1.0)


def fix(x_m: float, odds: float | None, *pixels: InitialPixel, sigma_m: float = 0.5, score: float = 1.0) -> Fix:
    return Fix(
        position_m=np.array([x_m, 200.0, 5.0]),
        covariance_m2=np.diag([sigma_m, 10.0 * sigma_m, sigma_m]) ** 2,
        score=score,
        labelled=False,
        odds=odds,
        pixels=pixels,
    )


def test_parts_of_an_aircraft_yield_to_it_and_what_is_apart_stays() -> None:
    aircraft, part, doubted, apart = fix(0.0, 2.5), fix(0.6, 1.0), fix(-0.6, -np.inf), fix(3.0, 1.0)
    assert without_lesser([part, apart, aircraft, doubted]) == [apart, aircraft]


def test_of_two_that_are_sure_the_better_fix_counts() -> None:
    rough, fine = fix(0.0, 6.0, sigma_m=1.0), fix(0.5, 3.2, sigma_m=0.3)
    assert without_lesser([rough, fine]) == [fine]


def test_without_odds_all_stay() -> None:
    fixes = [fix(0.0, None), fix(0.1, None), fix(0.0, -1.0)]
    assert without_lesser(fixes) == fixes
    # what the channel has not weighed is not less likely than what it has
    assert len(without_lesser([fix(0.0, 4.0), fix(0.1, None)])) == 2


def test_a_third_camera_s_pixel_is_kept_where_it_agrees() -> None:
    left, right, third = pixel("left"), pixel("right"), pixel("third")
    best = fix(0.0, 3.0, left, right)
    found = without_lesser([best, fix(0.2, 2.0, left, third)])
    assert [p.station for p in found[0].pixels] == ["left", "right", "third"]
    # neither with another pixel of the camera that both have, nor from a fix that is no aircraft
    for other in (fix(0.2, 2.0, pixel("left", 50.0), third), fix(0.2, -1.0, left, third)):
        found = without_lesser([best, other])
        assert [p.station for p in found[0].pixels] == ["left", "right"]


def test_two_aircraft_are_not_three() -> None:
    """A narrow fix of the pixels of two aircraft is a false pair; one of pixels of its own may be a fuselage."""
    left, right, other = pixel("left"), pixel("right"), pixel("left", 90.0)
    wide, false, fuselage = (
        fix(0.0, 3.0, left, right),
        fix(9.0, 4.0, other, right),
        fix(5.0, 1.0, other, pixel("right", 70.0)),
    )
    false, fuselage = replace(false, narrow=True), replace(fuselage, narrow=True)
    assert without_false_pairs([wide, false, fuselage]) == [wide, fuselage]
    # what is no likely aircraft does not speak against it
    assert len(without_false_pairs([replace(wide, odds=-1.0), false])) == 2
