"""Determined and undetermined parameters of a flight, and its clocks; from given numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.clocks.calibrate import TimingCalibration
from calibration.flight import start as flight_start
from calibration.flight import verdict as flight_verdict
from calibration.flight.observability import _TAUGHT, unobservable_parameters
from calibration.flight.start import find_start
from calibration.flight.verdict import _summary

NAMES = ("left.camera_clock.offset", "left.ptu_clock.offset", "right.camera_clock.offset")


def test_what_is_hardly_better_known_than_before_is_named() -> None:
    prior = np.array([1.0, 2.0, 3.0])
    sigma = np.array([0.99 * _TAUGHT, 1.01 * _TAUGHT, 0.1]) * prior
    fit = SimpleNamespace(problem=SimpleNamespace(names=NAMES, prior_sigma=prior), sigma=sigma)
    assert unobservable_parameters(fit) == [NAMES[1]]


def test_a_unit_is_later_than_its_camera_by_the_difference_of_their_clocks() -> None:
    change, covariance = np.array([0.010, 0.025, 0.004]), np.diag([4.0, 9.0, 1.0])
    fit = SimpleNamespace(problem=SimpleNamespace(names=NAMES), change=change, covariance=covariance)
    found = TimingCalibration(session=None, by_pictures={}, motions={}, by_flight=fit, rig=None)
    later = found.flight_ptu("left")
    assert (later.value_s, later.sigma_s) == pytest.approx((0.015, np.sqrt(13.0)))
    cameras = found.flight_cameras("left", "right")
    assert (cameras.value_s, cameras.sigma_s) == pytest.approx((-0.006, np.sqrt(5.0)))
    assert found.flight_ptu("third") is None


def test_parameters_that_are_mixed_up_and_those_untaught_are_both_not_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    for check in ("_far_off", "_misfits"):
        monkeypatch.setattr(flight_verdict, check, lambda *_: [])
    fit = SimpleNamespace(problem=SimpleNamespace(names=("a", "b", "c", "d", "e")))
    mixed, ranges = [SimpleNamespace(members=("a", "b"))], [SimpleNamespace(good=True, range_m=300.0)]
    known = "2 of 5 parameters are determined by themselves, the others in combinations only"
    assert _summary(fit, mixed, ["b", "c"], ranges) == f"good enough at all ranges looked at, to 300 m; {known}"
    assert _summary(fit, [], [], ranges).endswith("5 of 5 parameters are determined by themselves")


def test_a_station_with_a_known_pose_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[str] = []

    def start(problem: object, station: SimpleNamespace, observed: object) -> SimpleNamespace:
        started.append(station.name)
        return SimpleNamespace(station=station, offset_s=0.5)

    monkeypatch.setattr(flight_start, "_start", start)
    monkeypatch.setattr(flight_start, "replace", lambda problem, **changes: SimpleNamespace(**changes))
    known = {"left": ("orientation", "position"), "right": ("position",), "third": ("lens", "orientation", "position")}
    stations = {name: SimpleNamespace(name=name, known=parts) for name, parts in known.items()}
    problem = SimpleNamespace(
        stations=stations, observations=dict.fromkeys(stations), names=("right.camera_clock.offset", "x")
    )
    found = find_start(problem)
    assert started == ["right"]
    assert found.change.tolist() == [0.5, 0.0]
