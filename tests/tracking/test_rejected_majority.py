"""The largest set of cameras that agree, where the filter rejects some of them."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.triangulation import TriangulationView
from groundstation.tracking.alternative_track import AlternativeTrack, rejected_majority
from groundstation.tracking.epoch_buffer import EpochView, EpochViews
from tests.stereo_rig import make_station

PLACES = {"left": (-20.0, 0.0), "right": (20.0, 0.0), "third": (-10.0, 15.0), "fourth": (12.0, -8.0)}
SIGMA_PX = 1.0


def views(
    rng: np.random.Generator, accepted: set[str], off_px: dict[str, float], names: tuple[str, ...] = tuple(PLACES)
) -> list[EpochView]:
    """One pair's pixels of a target, those of ``off_px`` aside by so many px."""
    target = rng.uniform([-15.0, 90.0, 6.0], [15.0, 260.0, 30.0])
    found = []
    for name in names:
        station = make_station(name, *PLACES[name], fixed=True)
        object.__setattr__(station.lens, "focal_px", np.array([900.0, 900.0]))
        geometry = station.geometry()
        projection = geometry.project(target, 0.0, 0.0)
        assert projection is not None
        pixel = projection.pixel + rng.normal(0.0, SIGMA_PX, 2) + [0.0, off_px.get(name, 0.0)]
        view = TriangulationView(
            station=geometry,
            pixel=pixel,
            covariance_px2=SIGMA_PX**2 * np.eye(2),
            pan_rad=0.0,
            tilt_rad=0.0,
            angle_sigma_rad=0.0,
        )
        found.append(EpochView(t_s=1.0, epoch=1, station=name, view=view, accepted=name in accepted, labelled=False))
    return found


def names_of(found: list[EpochView]) -> set[str]:
    return {view.station for view in found}


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), wrong=st.sampled_from(sorted(PLACES)), right=st.sampled_from(sorted(PLACES)))
def test_three_that_agree_outweigh_two_that_were_accepted(seed: int, wrong: str, right: str) -> None:
    """Expected: without the wrong one, whichever it is, and whichever right one the filter accepted with it."""
    rng = np.random.default_rng(seed)
    found = rejected_majority(views(rng, {wrong, right}, {wrong: 60.0}))
    # a chance agreement is as good as the noise allows: one of a thousand
    if wrong != right:
        assert names_of(found) == set(PLACES) - {wrong}


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), wrong=st.sampled_from(sorted(PLACES)))
def test_what_the_filter_accepts_from_three_is_kept(seed: int, wrong: str) -> None:
    """Expected: nothing to correct where the one that was rejected is wrong."""
    rng = np.random.default_rng(seed)
    assert rejected_majority(views(rng, set(PLACES) - {wrong}, {wrong: 60.0})) == []
    assert rejected_majority(views(rng, set(PLACES), {})) == []


def test_two_cameras_are_no_majority(rng: np.random.Generator) -> None:
    two = views(rng, {"left"}, {"left": 60.0}, ("left", "right"))
    assert rejected_majority(two) == []
    three = views(rng, {"left"}, {"left": 60.0}, ("left", "right", "third"))
    assert rejected_majority(three) == []
    assert rejected_majority([]) == []


def test_all_that_agree_against_the_filter_are_a_majority(rng: np.random.Generator) -> None:
    agreeing = views(rng, set(), {})
    assert names_of(rejected_majority(agreeing)) == set(PLACES)
    assert names_of(rejected_majority([replace(view, accepted=view.station == "left") for view in agreeing])) == set(
        PLACES
    )


def test_the_target_is_restarted_where_three_agree_for_three_looks(rng: np.random.Generator) -> None:
    """Expected: at the third look, though nothing moves and the filter accepts the wrong pixel and one of the right."""
    stations = {}
    for name, place in PLACES.items():
        station = make_station(name, *place, fixed=True)
        object.__setattr__(station.lens, "focal_px", np.array([900.0, 900.0]))
        stations[name] = station.geometry()
    track = AlternativeTrack(stations, InitiationConfig(), None)
    found = []
    for k in range(4):
        at = [
            replace(view, t_s=0.1 * k) for view in views(np.random.default_rng(5), {"third", "fourth"}, {"third": 60.0})
        ]
        both = EpochViews(views=tuple(at), accepted=frozenset(("third", "fourth")), arrived_s=None)
        found.append(track.step(0.1 * k, both, known_lately=True))
    assert found[:2] == [None, None]
    assert found[2] is not None
    target = np.random.default_rng(5).uniform([-15.0, 90.0, 6.0], [15.0, 260.0, 30.0])
    sigma_m = np.sqrt(np.diag(found[2].covariance)[:3])
    assert np.all(np.abs(found[2].position_runway_m - target) < 4.0 * sigma_m)
