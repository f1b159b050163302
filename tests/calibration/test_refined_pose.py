"""Of poses with an equal fit the level one is selected, if it is the only one."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.landmarks import survey_start
from calibration.landmarks.rejection import LandmarkFitError
from calibration.landmarks.survey_start import _refined

LEVEL, OVER = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)


def station(x_m: float, wxyz: tuple[float, ...], cost: float = 1.0) -> SimpleNamespace:
    made = SimpleNamespace(
        name="left",
        known=("lens",),
        ptu_position_m=np.array([x_m, 0.0, 0.0]),
        runway_from_base_wxyz=np.array(wxyz),
        cost=cost,
    )
    made.changed = lambda change: made
    return made


def refined(*candidates: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    def fit(station: SimpleNamespace, *rest: object) -> SimpleNamespace:
        problem = SimpleNamespace(station_change=lambda *_, **__: np.zeros(9))
        return SimpleNamespace(length=np.array([np.sqrt(station.cost)]), change=None, problem=problem)

    monkeypatch.setattr(survey_start, "_own_fit", fit)
    return _refined(list(candidates), SimpleNamespace(landmark=np.arange(3)), [], None)


def test_the_one_that_fits_best_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    worse, better = station(0.0, LEVEL, cost=90.0), station(50.0, OVER, cost=1.0)
    assert refined(worse, better, monkeypatch=monkeypatch) is better


def test_of_those_that_fit_alike_the_level_one_is(monkeypatch: pytest.MonkeyPatch) -> None:
    over, level = station(0.0, OVER), station(50.0, LEVEL)
    assert refined(over, level, monkeypatch=monkeypatch) is level
    assert refined(level, station(50.0, LEVEL), over, monkeypatch=monkeypatch) is level


@pytest.mark.parametrize("turn", [LEVEL, OVER])
def test_equally_good_poses_are_refused(turn: tuple[float, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LandmarkFitError, match="got 2 poses that fit its 3 landmarks alike"):
        refined(station(0.0, turn), station(50.0, turn), monkeypatch=monkeypatch)
