"""Protection levels: do they hold, what do the residuals see, and how large is what they do not see?"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from groundstation.arrays import FloatArray
from groundstation.errors import ConfigError
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.integrity.fault_geometry import StationLook
from groundstation.integrity.protection_levels import (
    ProtectionConfig,
    ProtectionLevelMonitor,
    ProtectionLevels,
    separation_model,
)
from groundstation.landing_site.fault_table import FaultTable, StationFault, two_sided_quantile
from groundstation.messages import Kinematics
from groundstation.rig.rig import Rig
from groundstation.simulation.standard_cases import STEP_RAD, standard_rig
from tests.integrity.approach_reports import PATH, SITE, Looks, kinematics_at

NOISE = {"resolution_rad": 0.0, "sigma_rad": STEP_RAD / 12**0.5}
TWO, THREE = standard_rig(**NOISE), standard_rig(third=True, **NOISE)
SPAN_M = 2.3
# nothing but what the module's formulas are about: a fix of each pair, no constant error
PLAIN = ProtectionConfig(inflation=1.0, following=1.0, constant_px=0.0)
NEAR_S = 10.0


def fix_of(rig: Rig, looks: tuple[StationLook, ...]) -> Kinematics:
    """Return the maximum-likelihood fix of one pair with its covariance, by the triangulation."""
    sigma = rig.stations[0].angle_sigma_rad
    found = triangulate(
        [
            TriangulationView(
                station=rig[look.station].geometry(),
                pixel=look.pixel,
                covariance_px2=look.noise_px2,
                pan_rad=look.pan_rad,
                tilt_rad=look.tilt_rad,
                angle_sigma_rad=sigma,
            )
            for look in looks
        ]
    )
    assert found is not None
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = found.covariance_m2
    velocity = kinematics_at(looks[0].t_s).velocity_runway_m_s
    return Kinematics(position_runway_m=found.point_runway_m, velocity_runway_m_s=velocity, covariance=covariance)


def error_of(known: Kinematics, t_s: float) -> FloatArray:
    """Return (3,) the error along, right of and above the direction of landing."""
    return np.asarray(SITE.runway.axes() @ (known.position_runway_m - PATH.position(np.array([t_s]))[0]))


def drawn_fault(rng: np.random.Generator, fault: StationFault, table: FaultTable) -> dict[str, object]:
    """Return a fault of station left, or of the target point, drawn by its size."""
    b = rng.normal(size=3)
    depth_px_per_m = 6667.0 / np.linalg.norm(PATH.position(np.array([NEAR_S]))[0])
    match fault:
        case StationFault.DETECTION:
            return {"px": {"left": b[:2] * table.detection_spans * SPAN_M * depth_px_per_m}}
        case StationFault.MOUNT:
            return {"rad": {"left": b[:2] * table.mount_rad}}
        case StationFault.CLOCK:
            return {"late_s": {"left": b[0] * table.clock_s}}
        case StationFault.TARGET_POINT:
            return {"moved_m": SITE.runway.axes().T @ (b * SPAN_M * np.array(table.target_point_spans))}


@pytest.mark.parametrize("rig", [TWO, THREE], ids=["two", "three"])
def test_separations_without_a_fault_are_as_large_as_stated(rig: Rig, rng: np.random.Generator) -> None:
    """120 windows of one pair: mean squares of separations over their sigmas inside two-sided χ² bounds."""
    looks, draws = Looks(rig, rng), 120
    squares = []
    for _ in range(draws):
        monitor = ProtectionLevelMonitor(rig, SITE.runway, PLAIN)
        seen = looks.at(NEAR_S)
        monitor.add_pair(NEAR_S, fix_of(rig, seen), seen)
        sums = monitor.window()
        assert sums is not None
        model = separation_model(sums, 1.0)
        found = np.einsum("fad,fd->fa", model.from_residual, sums.residual)
        sigma = model.separation_sigma_m
        squares.append(np.divide(found, sigma, out=np.zeros_like(found), where=sigma > 1e-6) ** 2)
    mean = np.mean(squares, axis=0)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], draws) / draws
    tested = mean[mean > 0.0]
    assert len(tested) >= (6 if len(rig.stations) == 2 else 18)
    assert np.all((tested > low) & (tested < high))


@pytest.mark.parametrize("rig", [TWO, THREE], ids=["two", "three"])
@pytest.mark.parametrize("fault", list(StationFault))
def test_what_is_left_of_a_fault_is_as_large_as_stated(rig: Rig, fault: StationFault, rng: np.random.Generator) -> None:
    """The error less the separation has the stated variance, two-sided: what is seen is removed, the rest is not."""
    looks, draws, table = Looks(rig, rng), 80, FaultTable()
    whitened = []
    for _ in range(draws):
        monitor = ProtectionLevelMonitor(rig, SITE.runway, PLAIN)
        seen = looks.at(NEAR_S, **drawn_fault(rng, fault, table))  # type: ignore[arg-type]
        known = fix_of(rig, seen)
        monitor.add_pair(NEAR_S, known, seen)
        sums = monitor.window()
        assert sums is not None
        model = separation_model(sums, 1.0)
        k = next(
            i for i, h in enumerate(monitor.allocation.hypotheses) if h.fault is fault and h.station in ("left", "")
        )
        separation = model.from_residual[k] @ sums.residual[k]
        axes = SITE.runway.axes()
        own = np.diag(axes @ known.covariance[:3, :3] @ axes.T)
        whitened.append((error_of(known, NEAR_S) - separation) ** 2 / (own + model.fault_variance_m2[k]))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], draws) / draws
    assert np.all((np.mean(whitened, axis=0) > low) & (np.mean(whitened, axis=0) < high))


@pytest.mark.parametrize("rig", [TWO, THREE], ids=["two", "three"])
def test_levels_hold_with_the_probability_that_is_asked_for(rig: Rig, rng: np.random.Generator) -> None:
    """With a fault in each approach, an undetected error beyond a level is as rare as its share of the risk allows.

    Factors are 2.6 (0.01 each axis); with levels half as long it would happen more often than that.
    """
    p = 0.01
    count = len(FaultTable().hypotheses(rig.names)) + 1
    table = FaultTable(detection_prior=p, mount_prior=p, clock_prior=p, target_point_prior=p, exposures=1.0)
    risk = 3.0 * count * 0.01 * p + table.two_at_once(rig.names)
    config = replace(PLAIN, faults=replace(table, risk=risk))
    looks, draws = Looks(rig, rng), 250
    beyond = {1.0: 0, 0.5: 0}
    for k in range(draws):
        monitor = ProtectionLevelMonitor(rig, SITE.runway, config)
        assert monitor.allocation.faulty == pytest.approx(two_sided_quantile(0.01))
        seen = looks.at(NEAR_S, **drawn_fault(rng, list(StationFault)[k % 4], table))  # type: ignore[arg-type]
        known = fix_of(rig, seen)
        monitor.add_pair(NEAR_S, known, seen)
        levels = monitor.levels(NEAR_S, known)
        assert levels is not None
        bound = np.array([levels.along_m, levels.lateral_m, levels.vertical_m])
        for share in beyond:
            beyond[share] += bool(np.any(np.abs(error_of(known, NEAR_S)) > share * bound)) and not levels.fault_detected
    most = binom.ppf(1 - 1e-4, draws, 3 * 0.01)
    assert beyond[1.0] <= most < beyond[0.5]


def after(rig: Rig, rng: np.random.Generator, seconds: float = 0.5, **fault: object) -> ProtectionLevels:
    """Return the levels after so many seconds of a fault, at 10 Hz and with the usual tuning."""
    monitor, looks = ProtectionLevelMonitor(rig, SITE.runway), Looks(rig, rng)
    for t_s in NEAR_S + np.arange(0.0, seconds - 1e-9, 0.1):
        monitor.add_pair(t_s, kinematics_at(t_s), looks.at(float(t_s), **fault))  # type: ignore[arg-type]
    levels = monitor.levels(float(t_s), kinematics_at(float(t_s)))
    assert levels is not None
    return levels


def test_two_stations_see_a_tilt_and_not_a_pan(rng: np.random.Generator) -> None:
    pan, tilt = np.radians([0.3, 0.0]), np.radians([0.0, 0.3])
    assert not after(TWO, rng, rad={"left": pan}).fault_detected
    assert after(TWO, rng, rad={"left": tilt}).fault_detected
    # a third station sees either; which of the three is wrong, one bearing too many does not tell
    assert after(THREE, rng, rad={"left": pan}).fault_detected


def test_what_two_stations_do_not_see_enters_with_its_size(rng: np.random.Generator) -> None:
    """Six times the pan means six times the level along the runway; the tilt, which is seen, is no part of it."""
    along = {}
    for times in (1.0, 6.0):
        table = FaultTable(mount_rad=times * FaultTable().mount_rad, detection_prior=0.0, clock_prior=0.0)
        monitor = ProtectionLevelMonitor(TWO, SITE.runway, ProtectionConfig(faults=table))
        looks = Looks(TWO, rng)
        monitor.add_pair(NEAR_S, kinematics_at(NEAR_S), looks.at(NEAR_S))
        levels = monitor.levels(NEAR_S, kinematics_at(NEAR_S))
        assert levels is not None
        assert levels.worst[0].startswith("mount")
        along[times] = levels.along_m
        k = next(i for i, h in enumerate(monitor.allocation.hypotheses) if h.fault is StationFault.MOUNT)
        factor = monitor.allocation.faulty[k]
    # a pan of δ of one of two stations a baseline b apart moves the range R by R² δ / b
    y, b = float(PATH.position(np.array([NEAR_S]))[0, 1]), 10.77
    alone = 1.3 * factor * y**2 / b * 6.0 * FaultTable().mount_rad
    assert along[6.0] == pytest.approx(alone, rel=0.03)
    assert 5.5 < along[6.0] / along[1.0] < 6.05


def test_a_third_station_shortens_the_level_along_the_runway(rng: np.random.Generator) -> None:
    assert after(THREE, rng).along_m < 0.5 * after(TWO, rng).along_m


def test_a_less_certain_rig_has_wider_levels_and_a_blunter_test(rng: np.random.Generator) -> None:
    """Two stations whose tilts are known to 0.3° only: rays that miss each other by as much are no fault."""
    uncertain = replace(
        TWO,
        stations=tuple(
            replace(s, covariance_parameters=("runway_from_base.x",), covariance=np.radians([[0.3]]) ** 2)
            for s in TWO.stations
        ),
    )
    tilt = {"left": np.radians([0.0, 0.3])}
    assert after(TWO, rng, rad=tilt).separation > 5.0
    known, unknown = after(TWO, rng), after(uncertain, rng, rad=tilt)
    assert not unknown.fault_detected
    assert unknown.vertical_m > known.vertical_m


def test_one_station_alone_gives_no_level(rng: np.random.Generator) -> None:
    monitor, looks = ProtectionLevelMonitor(TWO, SITE.runway), Looks(TWO, rng)
    monitor.add_pair(0.0, kinematics_at(0.0), looks.at(0.0)[:1])
    assert monitor.levels(0.0, kinematics_at(0.0)) is None
    monitor.add_pair(0.1, kinematics_at(0.1), looks.at(0.1))
    assert monitor.levels(0.1, kinematics_at(0.1)) is not None
    # the window ends
    monitor.add_pair(0.7, kinematics_at(0.7), looks.at(0.7)[:1])
    assert monitor.levels(0.7, kinematics_at(0.7)) is None


def test_factors_by_the_risk() -> None:
    assert two_sided_quantile(0.05) == pytest.approx(1.95996, abs=1e-5)
    table = FaultTable()
    allocation = table.allocation(("left", "right"))
    assert len(allocation.hypotheses) == 7
    # what two faults at once leave, by three axes and eight hypotheses
    share = (1e-4 - table.two_at_once(("left", "right"))) / 24
    assert allocation.fault_free == pytest.approx(two_sided_quantile(share / 20.0))
    assert allocation.faulty[0] == pytest.approx(two_sided_quantile(share / 1e-3))
    rare = FaultTable(clock_prior=1e-9).allocation(("left", "right"))
    assert [bool(m) for m in rare.monitored] == [True, True, False] * 2 + [True]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mount_prior": 0.6}, "mount_prior: got 0.6"),
        ({"mount_rad": float("nan")}, "mount_rad: got nan"),
        ({"risk": 0.0}, "risk: got 0"),
        ({"target_point_spans": (0.1, -0.1, 0.1)}, "target_point_spans: got -0.1"),
    ],
)
def test_a_table_that_cannot_be_is_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        FaultTable(**change)  # type: ignore[arg-type]


def test_a_risk_below_that_of_two_faults_at_once_is_refused() -> None:
    with pytest.raises(ConfigError, match="two faults in one approach"):
        FaultTable(risk=1e-6).allocation(("left", "right"))
    # the default table is one for up to six stations; a rig of more is told what to state
    FaultTable().allocation(tuple("abcdef"))
    with pytest.raises(ConfigError, match=r"with 7 stations; or smaller priors, in \[faults\]"):
        FaultTable().allocation(tuple("abcdefg"))
    with pytest.raises(ConfigError, match="factors of 1 or more"):
        ProtectionConfig(inflation=0.5)
