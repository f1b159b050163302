"""A pan that is off, by how the width of silhouettes changes along a flight."""

from collections.abc import Callable

import numpy as np
import pytest

from groundstation.geometry.station import StationGeometry
from groundstation.integrity.relative_pan import PanFault, RelativePanMonitor
from tests.integrity.test_apparent_span import STATIONS, report
from tests.stereo_rig import make_station

_BASELINE_M, _SPAN_M, _PAIRS = 10.0, 2.3, 100
# what a pan that is off makes of the widths of one that turns by 50 deg
_FITTED_M = 0.82


def _found(
    pan_deg: float,
    *,
    seed: int = 1,
    span_m: Callable[[float], float] = lambda _: _SPAN_M,
    ranges_m: tuple[float, float] = (450.0, 110.0),
    scatter: float = 0.02,
    count: int = _PAIRS,
    stations: dict[str, StationGeometry] | None = None,
    given_m: float | None = _SPAN_M,
    loss: Callable[[float], float] = lambda _: 0.0,
) -> PanFault | None:
    """Return what is found of a flight whose ranges have a pan that is off; ``span_m`` by the share of the flight."""
    monitor = RelativePanMonitor(stations or STATIONS, given_m)
    rng = np.random.default_rng(seed)
    for epoch, true_m in enumerate(np.linspace(*ranges_m, count)):
        inverse = 1.0 / true_m + np.radians(pan_deg) / _BASELINE_M
        if inverse < 1e-3:
            # diverging rays, or nearly so
            continue
        width = (span_m(epoch / count) / true_m - loss(true_m)) * float(1.0 + scatter * rng.standard_normal())
        monitor.add(report(epoch, 1.0 / inverse, width / inverse))
    return monitor.fault()


@pytest.mark.parametrize("pan_deg", [2.0, 1.5, -1.0, 3.0])
def test_a_pan_that_is_off_is_named_with_its_size(pan_deg: float) -> None:
    fault = _found(pan_deg)
    assert fault is not None
    assert np.degrees(fault.pan_rad) == pytest.approx(pan_deg, abs=0.25)
    assert (fault.factor > 1.35) is (pan_deg > 0.0)
    assert f"off by {abs(np.degrees(fault.pan_rad)):.1f} deg against each other" in fault.line()
    assert f"too {'short' if pan_deg > 0.0 else 'long'}" in fault.line()


@pytest.mark.parametrize("seed", range(3))
def test_a_right_rig_is_believed(seed: int) -> None:
    """Expected: with widths that scatter as found ones, with little range and with aspects that change."""

    def half_found(share: float) -> float:
        return _SPAN_M * (0.6 if share < 0.4 else 1.0)

    assert _found(0.0, seed=seed) is None
    assert _found(0.3, seed=seed) is None
    assert _found(0.0, seed=seed, scatter=0.1) is None
    assert _found(0.0, seed=seed, ranges_m=(300.0, 240.0)) is None
    assert _found(0.0, seed=seed, span_m=half_found) is None


@pytest.mark.parametrize("turn_deg", [-50.0, 40.0, 50.0])
def test_an_aircraft_that_turns_is_no_wrong_pan(turn_deg: float) -> None:
    """Expected: its width changes as by a pan that is off; its path tells that it turns, and nothing is named."""
    found = []
    for turns in (False, True):
        monitor = RelativePanMonitor(STATIONS, _FITTED_M)
        place = np.array([0.0, 450.0])
        for epoch in range(_PAIRS):
            share = epoch / _PAIRS
            aspect = np.radians(turn_deg * share if turn_deg > 0.0 else -turn_deg * (1.0 - share))
            away = aspect if turns else 0.0
            range_m = float(np.hypot(*place))
            sight = np.arctan2(place[1], place[0])
            place = place - 2.4 * np.array([np.cos(sight + away), np.sin(sight + away)])
            monitor.add(report(epoch, range_m, _SPAN_M * float(np.cos(aspect)), bearing_rad=float(np.pi / 2 - sight)))
        found.append(monitor.fault())
    assert found[1] is None
    assert found[0] is not None or turn_deg != 50.0


def test_what_cannot_tell_says_nothing() -> None:
    assert _found(2.0, ranges_m=(300.0, 260.0)) is None
    assert _found(2.0, count=50) is None
    assert _found(2.0, scatter=0.2) is None
    third = STATIONS | {"third": make_station("third", 20.0).geometry()}
    assert _found(2.0, stations=third) is None
    assert _found(2.0, given_m=None) is None
    assert _found(2.0, given_m=3.0) is None


@pytest.mark.parametrize("given_m", [None, _SPAN_M])
def test_wing_tips_that_fade_are_no_wrong_pan(given_m: float | None) -> None:
    """Expected: a constant loss of angle is of the form of a pan, and a loss that grows with range is near to it."""
    for share in (0.1, 0.25, 0.35):
        assert _found(0.0, given_m=given_m, loss=lambda _, s=share: s * _SPAN_M / 280.0) is None
        assert _found(0.0, given_m=given_m, loss=lambda r, s=share: s * _SPAN_M / 280.0 * r / 450.0) is None
