"""Faults of stations: how often falsely accused, how soon found, what excluding brings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.integrity.solution_separation import PixelResidual
from groundstation.integrity.station_exclusion import IntegrityConfig, IntegrityMonitor, StationVerdict
from groundstation.messages import DetectionStatus, PixelMeasurement
from groundstation.simulation import StationErrors, perturbed, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.standard_cases import drawn_glide
from tests.faulty_flight import STATIONS, broken, consistency, drawn_path, rig_of, scenario, watch, without

BUMP_S = 4.0
OFF = IntegrityConfig(enabled=False)


def mount(pan_deg: float = 0.0, tilt_deg: float = 0.0) -> StationErrors:
    return StationErrors(mount_rad=np.radians([tilt_deg, 0.0, pan_deg]))


def residuals(
    rng: np.random.Generator, bias_px: dict[str, np.ndarray] | None = None, count: int = 3
) -> list[PixelResidual]:
    """Noise of 1 px about a target 200 m away that stands anywhere: a common move explains nothing."""
    point, moved = np.array([0.0, 200.0, 8.0]), rng.normal(0, 3.0, 3)
    out = []
    for station in rig_of(STATIONS[:count]).stations:
        geometry = station.geometry()
        offset = point - station.ptu_position_m
        pan, tilt = -np.arctan2(offset[0], offset[1]), np.arctan2(offset[2], np.hypot(offset[0], offset[1]))
        projection = geometry.project(point, float(pan), float(tilt))
        assert projection is not None
        H = projection.jacobian[:, :3]
        off = (bias_px or {}).get(station.name, np.zeros(2))
        residual = H @ moved + rng.normal(0, 1.0, 2) + off
        out.append(PixelResidual(station=station.name, residual_px=residual, jacobian_px_per_m=H, noise_px2=np.eye(2)))
    return out


def test_separation_is_chi_square_whatever_the_target_does(rng: np.random.Generator) -> None:
    """T of one window, 150 times, the target thrown about by metres from epoch to epoch."""
    exact = IntegrityConfig(constant_px=0.0)
    for count, dof in ((2, 1), (3, 2)):
        values = []
        for _ in range(150):
            watcher = IntegrityMonitor(STATIONS[:count], exact)
            for k in range(10):
                watcher.epoch(0.1 * k, residuals(rng, count=count))
            found = watcher.separation("left")
            assert found.dof == dof
            values.append(found.statistic)
        low, high = chi2.ppf([0.001, 0.999], dof * len(values)) / len(values)
        assert low < np.mean(values) < high


def test_false_alarms_are_as_rare_as_stated(rng: np.random.Generator) -> None:
    """At 200 an hour, for a countable number, in 0.12 h: no more than three sigmas above it."""
    watcher = IntegrityMonitor(STATIONS, IntegrityConfig(constant_px=0.0, false_alarms_per_hour=200.0))
    alarms = 0
    hours = 0.12
    for k in range(int(hours * 36000)):
        for finding in watcher.epoch(0.1 * k, residuals(rng)):
            if finding.verdict is not StationVerdict.TRUSTED:
                alarms += 1
                watcher = IntegrityMonitor(STATIONS, IntegrityConfig(constant_px=0.0, false_alarms_per_hour=200.0))
    expected = 200.0 * hours
    assert 0.05 * expected < alarms < expected + 3.0 * expected**0.5


def test_one_gross_outlier_is_no_fault(rng: np.random.Generator) -> None:
    watcher = IntegrityMonitor(STATIONS, IntegrityConfig())
    for k in range(60):
        off = {"right": np.array([400.0, -90.0])} if k in (10, 37) else {}
        assert not watcher.epoch(0.1 * k, residuals(rng, off))


@pytest.mark.parametrize("kind", ["glide", "manoeuvre", "calibration"])
def test_no_station_is_accused_without_fault(kind: str) -> None:
    """Gliding, thrown about with (3, 12, 6) m²/s³, and with unmodelled mount errors of 0.004° rms."""
    for seed in range(6):
        path = drawn_glide(seed, (3.0, 12.0, 6.0), GlideApproach(start_y_m=400.0, end_y_m=150.0))
        flight = scenario(seed, trajectory=path if kind == "manoeuvre" else None)
        if kind == "calibration":
            draw = np.random.default_rng(seed).normal(0, 0.004, (3, 2))
            errors = {name: mount(*draw[k]) for k, name in enumerate(STATIONS)}
            watched = watch(broken(flight, errors, -1.0))
        else:
            watched = watch(simulate(flight))
        assert watched.pipeline.counts["stations_doubted"] == 0
        assert watched.pipeline.counts["stations_excluded"] == 0


@pytest.mark.parametrize(
    ("station", "error"),
    [
        ("left", mount(tilt_deg=0.05)),
        ("third", mount(tilt_deg=-0.05)),
        ("left", mount(pan_deg=0.05)),
        ("right", mount(pan_deg=-0.05)),
        ("third", StationErrors(ptu_offset_s=0.15)),
    ],
    ids=["tilt-left", "tilt-third", "pan-left", "pan-right", "clock-third"],
)
def test_a_faulty_station_is_named_and_left_out(station: str, error: StationErrors) -> None:
    """Three stations, a bump of 0.05° or a PTU clock that jumps by 0.15 s: named within 2.5 s, no other ever; the
    remaining estimate is consistent."""
    flights = []
    for seed in range(3):
        watched = watch(broken(scenario(seed, trajectory=drawn_path(seed)), {station: error}, BUMP_S))
        flights.append(watched)
        left_out = watched.reported("no longer used")
        assert [e.text.split(":")[0] for e in left_out] == [f"station {station}"]
        assert 0.0 < left_out[0].t_s - BUMP_S < 2.5
        after = [c for c in watched.cameras if c.station == station and c.t_s > left_out[0].t_s + 0.1]
        assert {c.status for c in after} == {DetectionStatus.EXCLUDED}
        assert watched.pipeline.counts["stations_excluded"] == 1
        assert watched.pipeline.counts["excluded_pixels"] >= len(after)
    left = consistency(flights, BUMP_S + 3.0)
    assert left.right, left


def test_what_the_rig_file_states_is_no_fault() -> None:
    """Modelled mount errors of 0.01° rms raise no alarm; a jump of 0.1° is detected in its own station only."""
    sigma = np.radians(0.01)
    names = tuple(f"runway_from_base.{axis}" for axis in "xyz")
    for seed in range(4):
        flight = scenario(seed)
        stations = [
            replace(s, covariance_parameters=names, covariance=np.eye(3) * sigma**2) for s in flight.rig.stations
        ]
        draw = np.random.default_rng(seed).normal(0, sigma, (3, 3))
        errors = {name: StationErrors(mount_rad=draw[k]) for k, name in enumerate(STATIONS)}
        stated = replace(
            flight, rig=replace(flight.rig, stations=tuple(stations)), true_rig=perturbed(flight.rig, errors)
        )
        healthy = watch(simulate(stated))
        assert healthy.pipeline.counts["stations_excluded"] == healthy.pipeline.counts["stations_doubted"] == 0
        bumped = watch(broken(stated, {"left": mount(tilt_deg=0.1)}, BUMP_S))
        assert [e.text.split(":")[0] for e in bumped.reported("no longer used")] == ["station left"]


def test_excluding_keeps_the_error_down() -> None:
    """The left mount bumped by 0.05° in tilt: height to a tenth, range to a third of what it is without exclusion."""
    kept, spoilt = [], []
    for seed in range(3):
        flight = broken(scenario(seed), {"left": mount(tilt_deg=0.05)}, BUMP_S)
        kept.append(watch(flight).rmse(BUMP_S + 2.0))
        spoilt.append(watch(flight, OFF).rmse(BUMP_S + 2.0))
    better = np.mean(spoilt, axis=0) / np.mean(kept, axis=0)
    assert better[1] > 3.0
    assert better[2] > 10.0


def test_a_wrong_target_is_left_out() -> None:
    """The right camera follows something else away at 3 px/s, slower than the gate sees."""
    flight = simulate(scenario(1))
    events = [
        replace(e, u_px=e.u_px + 3.0 * max(e.t_s - BUMP_S, 0.0), v_px=e.v_px - 2.0 * max(e.t_s - BUMP_S, 0.0))
        if isinstance(e, PixelMeasurement) and e.station == "right"
        else e
        for e in flight.events
    ]
    watched = watch(flight, events=events)
    left_out = watched.reported("no longer used")
    assert [e.text.split(":")[0] for e in left_out] == ["station right"]
    assert left_out[0].t_s - BUMP_S < 3.0


def test_a_station_that_agrees_again_is_used_again() -> None:
    """A mount pushed for 1.5 s and released: excluded, and readmitted three seconds after it agrees."""
    pushed = broken(scenario(2), {"left": mount(tilt_deg=0.06)}, BUMP_S)
    healthy = simulate(scenario(2))
    events = [e for e in pushed.events if e.t_s < 5.5] + [e for e in healthy.events if e.t_s >= 5.5]
    watched = watch(healthy, events=events)
    assert len(watched.reported("no longer used")) == 1
    back = watched.reported("trusted again")
    assert len(back) == 1
    assert 8.5 <= back[0].t_s < 10.0
    assert [c.status for c in watched.cameras if c.station == "left"][-1] is DetectionStatus.OK


@pytest.mark.parametrize(("min_epochs", "readmit_s"), [(5, 0.2), (16, 0.2), (5, 1.5)])
def test_a_station_is_readmitted_only_after_enough_epochs_over_enough_time(
    rng: np.random.Generator, min_epochs: int, readmit_s: float
) -> None:
    """Expected: windows begin empty at the exclusion; first the epochs are there, then it has to agree for the time.

    The fault is gone at once, so nothing else delays it; verdicts are given each 0.2 s. In one draw of seven two
    stations are doubted before one of them is excluded, as the rules allow.
    """
    config = IntegrityConfig(min_epochs=min_epochs, readmit_s=readmit_s, constant_px=0.1)
    watcher, out_s, back_s = IntegrityMonitor(STATIONS, config), None, None
    for k in range(100):
        t_s = 0.1 * k
        off = {"left": np.array([0.0, 6.0])} if out_s is None and k >= 10 else {}
        for finding in watcher.epoch(t_s, residuals(rng, off)):
            if finding.verdict is StationVerdict.DOUBTED and out_s is None:
                continue
            assert finding.stations == ("left",)
            if finding.verdict is StationVerdict.EXCLUDED:
                out_s = t_s
            else:
                back_s = t_s
        if back_s is not None:
            break
    assert out_s is not None
    assert back_s is not None
    least_s = 0.1 * min_epochs + readmit_s
    assert least_s - 1e-9 <= back_s - out_s <= least_s + 0.4 + 1e-9
    assert watcher.verdict("left") is StationVerdict.TRUSTED


@pytest.mark.parametrize(("share", "trusted"), [(0.45, True), (0.55, False), (0.9, False)])
def test_in_and_out_are_not_the_same_limit(share: float, trusted: bool) -> None:
    """Expected: an excluded station that is off by less than it takes to be accused stays out down to half of that.

    Without noise, T of a constant offset is proportional to its square.
    """
    quiet = SimpleNamespace(normal=lambda mean, sigma, size: np.zeros(size))
    config = IntegrityConfig(constant_px=0.0, readmit_s=0.4)

    def left_off(watcher: IntegrityMonitor, px: float, epochs: range) -> float:
        for k in epochs:
            watcher.epoch(0.1 * k, residuals(quiet, {"left": np.array([0.0, px])}))  # type: ignore[arg-type]
        return watcher.separation("left").statistic

    # false alarms each 0.1 h, over three stations and windows of 2 s, five of them as one
    limit = chi2.isf(0.1 / (1800.0 * 5.0 * 3.0), 2)
    per_px2 = left_off(IntegrityMonitor(STATIONS, replace(config, false_alarms_per_hour=1e-9)), 1.0, range(40))
    watcher = IntegrityMonitor(STATIONS, config)
    left_off(watcher, 6.0, range(20))
    assert watcher.verdict("left") is StationVerdict.EXCLUDED
    left = left_off(watcher, float(np.sqrt(share * limit / per_px2)), range(20, 80))
    # the window's end may hold one epoch more, by the rounding of its stamps
    assert share * limit <= left * (1.0 + 1e-9) < 1.06 * share * limit
    assert (watcher.verdict("left") is StationVerdict.TRUSTED) is trusted


def test_of_two_that_are_hardly_distinguishable_none_is_excluded_for_being_first(rng: np.random.Generator) -> None:
    """A pan of the right station drifts by 5 px a second to 6 px, forty times.

    Expected: left and right are doubted, since the separation of either is within the margin of the other's. Where
    one was beyond the limit some tenths of a second before the other, it was excluded alone: the left one twice in 60.
    """
    excluded = []
    for _ in range(40):
        watcher = IntegrityMonitor(STATIONS, IntegrityConfig())
        for k in range(80):
            off = np.array([np.clip(0.5 * (k - 40), 0.0, 6.0), 0.0])
            for change in watcher.epoch(0.1 * k, residuals(rng, {"right": off})):
                excluded += [change.stations] if change.verdict is StationVerdict.EXCLUDED else []
    assert not excluded


def test_a_fault_that_is_plain_after_a_doubt_is_excluded(rng: np.random.Generator) -> None:
    """The third station's height is off by 6 px from 4 s on. Expected: it alone is excluded by 7 s, doubts or not."""
    for _ in range(20):
        watcher = IntegrityMonitor(STATIONS, IntegrityConfig())
        for k in range(70):
            watcher.epoch(0.1 * k, residuals(rng, {"third": np.array([0.0, 6.0])} if k >= 40 else None))
        assert watcher.verdict("third") is StationVerdict.EXCLUDED
        assert {watcher.verdict(name) for name in ("left", "right")} == {StationVerdict.TRUSTED}


@pytest.mark.parametrize("pixels_off", [15.0, 80.0], ids=["doubted", "excluded"])
def test_what_one_station_alone_agrees_in_readmits_nothing(pixels_off: float, rng: np.random.Generator) -> None:
    """A pan of the left station jumps at 4 s, the third station is gone from 8 to 20 s, the pan is mended at 14 s.

    The two that are left agree in height, whatever their pans. Expected: trusted again once the third has been back for
    as long as readmission takes, not before.
    """
    watcher, trusted = IntegrityMonitor(STATIONS, IntegrityConfig()), []
    for k in range(300):
        t_s = 0.1 * k
        off = {"left": np.array([pixels_off, 0.0])} if 4.0 <= t_s < 14.0 else None
        seen = [r for r in residuals(rng, off) if r.station != "third" or not 8.0 <= t_s < 20.0]
        if 4.0 <= t_s < 4.3:
            # only the one at fault jumps
            watcher.add_innovation("left", t_s, np.array([pixels_off, 0.0]), np.eye(2))
        trusted += [t_s for change in watcher.epoch(t_s, seen) if change.verdict is StationVerdict.TRUSTED]
        if t_s == 7.0:
            assert watcher.verdict("left") is not StationVerdict.TRUSTED
    assert len(trusted) == 1
    assert 23.0 <= trusted[0] < 26.0


def test_an_excluded_station_does_not_come_back_where_another_one_is_lost() -> None:
    """0.2° of the left pan at 4 s, the third station lost at 6.5 s. Expected: no position from the two that are left.

    With both of them the error along the runway was 7 m at a sigma of 0.15 m. One camera alone has one of tens of
    metres, valid for some seconds.
    """
    flight = broken(scenario(1, trajectory=drawn_path(1, 450.0, 100.0)), {"left": mount(pan_deg=0.2)}, BUMP_S)
    watched = watch(flight, events=without(flight, {"third": (6.5, 99.0)}))
    assert len(watched.reported("left: pixels off")) == 1
    assert not watched.reported("trusted again")
    known = [e.kinematics for e in watched.estimates if e.kinematics is not None and 11.3 < e.t_s < 13.0]
    assert known
    assert min(k.covariance[1, 1] for k in known) > 5.0**2


def test_two_stations_cannot_identify_the_faulty_one() -> None:
    """Differential tilt is detected, both stations doubted, none excluded, and the covariance matches the error;
    differential pan is not observable: it is equivalent to range."""
    doubting, believing = [], []
    for seed in range(3):
        flight = broken(
            scenario(seed, ("left", "right"), trajectory=drawn_path(seed)), {"left": mount(tilt_deg=0.05)}, BUMP_S
        )
        watched, spoilt = watch(flight), watch(flight, OFF)
        doubting.append(watched)
        believing.append(spoilt)
        doubted = watched.reported("cannot be identified")
        assert doubted
        assert "left and right" in doubted[0].text
        assert not watched.reported("no longer used")
        pan = watch(broken(scenario(seed, ("left", "right")), {"left": mount(pan_deg=0.05)}, BUMP_S))
        assert not pan.reported("station")
    held, lost = consistency(doubting, BUMP_S + 2.0), consistency(believing, BUMP_S + 2.0)
    assert held.right, held
    assert lost.mean > 3.0 * lost.high


@pytest.mark.parametrize(("beyond", "epochs", "alarmed"), [(0.0, 5, False), (1e-9, 5, True), (1e-9, 4, False)])
def test_only_values_beyond_the_limit_alarm(beyond: float, epochs: int, alarmed: bool) -> None:
    config = IntegrityConfig()
    assert config.min_epochs == 5
    watched = IntegrityMonitor(("left", "right"), config)
    separation = SimpleNamespace(epochs=epochs, dof=2, statistic=watched._limits[2] + beyond)
    watched.separation = lambda name: separation
    assert list(watched._alarms(["left"])) == (["left"] if alarmed else [])
