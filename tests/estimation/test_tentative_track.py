"""Tentative tracks that share fixes: a false one takes none from an aircraft, and copies of one track are one."""

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.initial_fix import Fix
from groundstation.estimation.initialise import TrackInitiator
from groundstation.estimation.tentative_track import InitiatedTarget, TentativeTrack, without_copies
from tests.stereo_rig import make_rig

STEP_S = 0.1
SIGMA_M = np.array([0.2, 1.0, 0.2])


def fix(position_m: FloatArray, odds: float | None, score: float = 1.0) -> Fix:
    return Fix(position_m=position_m, covariance_m2=np.diag(SIGMA_M**2), score=score, labelled=False, odds=odds)


def aircraft(t_s: float) -> FloatArray:
    return np.array([1.0, 160.0 - 26.0 * t_s, 8.0 - t_s])


def followed(epochs: list[list[Fix]]) -> list[tuple[InitiatedTarget, ...]]:
    """Step an initiator through the fixes of epochs."""
    stations = {station.name: station.geometry() for station in make_rig().stations}
    initiator = TrackInitiator(stations, InitiationConfig(), None)
    found = []
    for k, fixes in enumerate(epochs):
        initiator.fixes = lambda sightings, fixes=fixes: list(fixes)  # type: ignore[method-assign]
        found.append(initiator.step(STEP_S * k, ()))
    return found


def test_false_tracks_take_no_fix_from_an_aircraft(rng: np.random.Generator) -> None:
    """Expected: recognised after four fixes, among false tracks that began before and reach out for its fixes."""
    epochs = []
    for k in range(14):
        t_s = STEP_S * k
        around = [fix(aircraft(0.6) + rng.normal(0.0, [3.0, 9.0, 2.0]), -4.0) for _ in range(12)]
        own = [fix(aircraft(t_s) + rng.normal(0.0, SIGMA_M), 5.0)] if k >= 6 else []
        epochs.append([*own, *around])
    found = followed(epochs)
    assert not any(found[:6])
    first = next(k for k, targets in enumerate(found) if targets)
    assert first <= 6 + 5
    target = found[first][0]
    assert target.recognised
    assert np.linalg.norm(target.kinematics.position_runway_m - aircraft(STEP_S * first)) < 2.5


def test_an_aircraft_that_is_seen_less_clearly_for_a_frame_keeps_its_age(rng: np.random.Generator) -> None:
    """Expected: one track, as old as its first fix, though one fix of low odds starts another."""
    odds = [3.0, 3.0, -3.0, 3.0, 3.0, -3.0, 3.0, 3.0, 3.0, 3.0]
    epochs = [[fix(aircraft(STEP_S * k) + rng.normal(0.0, 0.3 * SIGMA_M), odds[k])] for k in range(10)]
    targets = [target for each in followed(epochs) for target in each]
    assert targets
    assert targets[-1].age_s == pytest.approx(0.9, abs=1e-6)


def track(x: FloatArray, hits: int, squares: float, odds: float, misses: int = 0) -> TentativeTrack:
    return TentativeTrack(
        t_s=1.0,
        born_s=1.0 - 0.1 * hits,
        x=x,
        P=np.diag([0.1, 0.1, 0.1, 4.0, 4.0, 4.0]),
        newest_covariance_m2=np.eye(3),
        hits=hits,
        misses=misses,
        squares=squares,
        recent_odds=[odds],
    )


def test_of_copies_the_one_stays_that_moves_as_its_filter_expects() -> None:
    x = np.array([0.0, 100.0, 5.0, 0.0, -25.0, 0.0])
    near, apart = x + 0.1, x + [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    steady, jumping, young = track(x, 5, 8.0, 2.0), track(near, 7, 60.0, 2.0), track(near, 2, 1.0, 4.0)
    assert without_copies([jumping, young, steady]) == [steady]
    likely = track(near, 3, 30.0, 5.0)
    assert without_copies([jumping, likely]) == [likely]
    other, missed = track(apart, 2, 1.0, -3.0), track(near, 2, 1.0, 4.0, misses=1)
    # at another place, or without a fix now, it is no copy
    assert set(map(id, without_copies([steady, other, missed]))) == {id(steady), id(other), id(missed)}
