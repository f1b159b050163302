"""Wrong rigs and clocks: the filter's estimates of them, their effect, and the consistency of its covariance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from filter_flights.bounds import full_bound, track_bound
from filter_flights.consistency import WIDE, Sample, drawn_case, one_mode, with_drawn_heads
from filter_flights.run_filter import drawn_start, drive
from groundstation.arrays import FloatArray
from groundstation.estimation.config import CalibrationUse, EstimationConfig
from groundstation.estimation.parameters import ParameterPrior
from groundstation.messages import DgpsFix
from groundstation.simulation import Scenario, StationErrors, case_b, perturbed, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.path_deviation import drawn_deviation
from groundstation.simulation.pointing import DisturbedPointing, SecondOrderLoop
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.standard_cases import BOUND_PSD_M2_S3
from groundstation.simulation.take_off import TakeOff, take_off
from groundstation.simulation.trajectory import SuperposedTrajectory

STATIONS = ("left", "right")
MOUNT_SIGMA_RAD = float(np.radians(0.05))
CLOCK_SIGMA_S = 0.02
DRIFT_SIGMA = 1e-3
DGPS_SIGMA_M = 0.02
PAN_AND_TILT = tuple(f"{s}.runway_from_base.{axis}" for s in STATIONS for axis in ("z", "x"))
ROLL_AND_BORESIGHT = tuple(
    f"{s}.{part}" for s in STATIONS for part in ("runway_from_base.y", "head_from_camera.x", "head_from_camera.z")
)
# one camera's clock is the session's own: only differences are observable
CLOCK_OFFSETS = ("right.camera_clock.offset", *(f"{s}.ptu_clock.offset" for s in STATIONS), "dgps_clock.offset")
CLOCK_DRIFTS = ("right.camera_clock.drift", "dgps_clock.drift")
_AXES = ("x", "y", "z")
# seconds before the first pair at which readings begin, and with them the age of a drift
_LEAD_S = 0.5
# stamps that are early by a clock's error must not come before the start
_START_LEAD_S = 0.2


def usual_prior(names: Sequence[str]) -> ParameterPrior:
    """Return independent errors: 0.05° of a rotation, 20 ms of a clock, 1 ms/s of its drift."""

    def sigma(name: str) -> float:
        if "_clock" in name:
            return DRIFT_SIGMA if name.endswith("drift") else CLOCK_SIGMA_S
        return MOUNT_SIGMA_RAD

    return ParameterPrior.independent(names, [sigma(n) for n in names])


def drawn_parameters(prior: ParameterPrior, seed: int) -> FloatArray:
    """Return one draw (m,) from a prior."""
    generator = np.random.default_rng([seed, 31])
    return np.asarray(np.linalg.cholesky(prior.covariance) @ generator.normal(size=len(prior.names)))


def with_errors(scenario: Scenario, names: Sequence[str], values: FloatArray) -> Scenario:
    """Return the scenario whose truth differs from the assumed rig by these parameters."""
    errors = {s: StationErrors() for s in scenario.rig.names}
    first_s = scenario.trajectory.span_s[0] - _LEAD_S
    dgps = scenario.dgps
    for name, value in zip(names, values.tolist(), strict=True):
        station, _, parameter = name.partition(".")
        if station == "dgps_clock":
            # its model gives the lag of the stamps; the filter's error, that of the positions
            assert dgps is not None
            if parameter == "drift":
                offset = dgps.clock_offset_s + value * first_s
                dgps = replace(dgps, clock_offset_s=offset, clock_drift_ppm=-1e6 * value)
            else:
                dgps = replace(dgps, clock_offset_s=dgps.clock_offset_s - value)
            continue
        group, _, part = parameter.partition(".")
        own = errors[station]
        match group:
            case "runway_from_base":
                own = replace(own, mount_rad=own.mount_rad + value * np.eye(3)[_AXES.index(part)])
            case "head_from_camera":
                own = replace(own, boresight_rad=own.boresight_rad + value * np.eye(3)[_AXES.index(part)])
            case "camera_clock" if part == "offset":
                own = replace(own, camera_offset_s=own.camera_offset_s + value)
            case "camera_clock":
                offset = own.camera_offset_s - value * first_s
                own = replace(own, camera_offset_s=offset, camera_drift_ppm=1e6 * value)
            case "ptu_clock":
                own = replace(own, ptu_offset_s=own.ptu_offset_s + value)
            case _:
                raise ValueError(f"no error is made for {name!r}")
        errors[station] = own
    return replace(scenario, true_rig=perturbed(scenario.rig, errors), dgps=dgps)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationErrors:
    """Errors of the estimated rig and clock parameters over r runs: ``error`` and its own and the bound's ``sigma``.

    All (r, m); ``names`` (m,).
    """

    names: tuple[str, ...]
    error: FloatArray
    sigma: FloatArray
    bound: FloatArray

    def rms(self) -> FloatArray:
        """Return the rms error (m,)."""
        return np.asarray(np.sqrt((self.error**2).mean(axis=0)))

    def rms_bound(self) -> FloatArray:
        """Return the bound (m,), variances averaged."""
        return np.asarray(np.sqrt((self.bound**2).mean(axis=0)))


def after_reference(
    names: Sequence[str],
    seeds: Sequence[int],
    rate_hz: float = 30.0,
    use: CalibrationUse = CalibrationUse.REFERENCE,
    *,
    straight: bool = False,
) -> Sample:
    """Case B with these errors of 0.05° unknown, 2 cm DGPS above y = 400 m, nothing but pictures below.

    ``straight`` flies the nominal glide and not a draw around it.
    """
    config = replace(one_mode(), calibration=use)
    prior = usual_prior(names)
    runs, bounds = [], []
    for seed in seeds:
        plain = replace(drawn_case("B", seed, rate_hz), dgps=_receiver(rate_hz))
        plain = replace(plain, trajectory=GlideApproach()) if straight else plain
        flight = simulate(with_errors(plain, names, drawn_parameters(prior, seed)))
        far = _above(plain, 400.0)
        runs.append(drive(flight, config, drawn_start(flight, seed, *WIDE), prior=prior, reference=far))
        bound = track_bound(flight, BOUND_PSD_M2_S3, WIDE, prior, lambda y: DGPS_SIGMA_M if y > 400.0 else None)
        bounds.append(np.diagonal(bound[:, :3, :3], axis1=1, axis2=2))
    return Sample(runs=runs, bound_m2=np.array(bounds))


def considered(names: Sequence[str], seeds: Sequence[int], *, known: bool) -> Sample:
    """Case B at 10 Hz with errors drawn from their prior and never learnt; ``known`` of to the filter, or not."""
    prior = usual_prior(names)
    config = replace(one_mode(), calibration=CalibrationUse.CONSIDER)
    runs = []
    for seed in seeds:
        scenario = with_errors(drawn_case("B", seed, 10.0), names, drawn_parameters(prior, seed))
        flight = simulate(scenario)
        carried = prior if known else None
        runs.append(drive(flight, config, drawn_start(flight, seed, *WIDE, lead_s=_START_LEAD_S), prior=carried))
    return Sample(runs=runs, bound_m2=np.zeros((0, 0, 3)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFlight:
    """A flight for learning clocks: its name, the scenario of a seed, and the tuning that it takes."""

    name: str
    scenario: Callable[[int], Scenario]
    config: EstimationConfig


def clock_wandering(ptu_psd_rad2_s3: float = 1e-6) -> ClockFlight:
    """Return case B's drawn approach to y = 160 m, heads that aim but for a wander drawn from the filter's model.

    Aiming turns them besides, the more the nearer the aircraft is: that is not in the model's PSD.
    """

    def scenario(seed: int) -> Scenario:
        plain = _driven(drawn_case("B", seed, 30.0, GlideApproach(end_y_m=160.0)), 30.0)
        start, end = plain.trajectory.span_s
        ptus = {
            name: replace(
                model,
                pointing=DisturbedPointing(
                    deviation=drawn_deviation(
                        np.random.default_rng([seed, 5, k]),
                        span_s=(start - 1.5, end + 1.5),
                        acceleration_psd_m2_s3=(ptu_psd_rad2_s3, ptu_psd_rad2_s3, 0.0),
                    )
                ),
            )
            for k, (name, model) in enumerate(plain.ptus.items())
        }
        return replace(plain, ptus=ptus)

    config = replace(one_mode(), ptu_acceleration_psd_rad2_s3=ptu_psd_rad2_s3)
    return ClockFlight(name="approach to 160 m, heads that aim and wander", scenario=scenario, config=config)


def clock_drawn(ptu_psd_rad2_s3: float = 1e-6) -> ClockFlight:
    """Return case B's drawn approach to y = 160 m, all of it from the filter's model: heads left to themselves, too."""

    def scenario(seed: int) -> Scenario:
        plain = _driven(drawn_case("B", seed, 30.0, GlideApproach(end_y_m=160.0)), 30.0)
        return with_drawn_heads(plain, seed, ptu_psd_rad2_s3)

    config = replace(one_mode(), ptu_acceleration_psd_rad2_s3=ptu_psd_rad2_s3)
    return ClockFlight(name="approach to 160 m, drawn from the filter's model", scenario=scenario, config=config)


def clock_take_off() -> ClockFlight:
    """Return a take-off towards the cameras, with what white acceleration adds to it."""
    psd = (0.3, 1.0, 0.3)

    def scenario(seed: int) -> Scenario:
        plan = take_off(TakeOff())
        drawn = drawn_deviation(
            np.random.default_rng([seed, 77]), span_s=plan.span_s, acceleration_psd_m2_s3=BOUND_PSD_M2_S3
        )
        flight = SuperposedTrajectory(nominal=plan, deviation=drawn)
        return _driven(case_b(seed=seed, rate_hz=30.0, trajectory=flight, white_encoder=True), 30.0)

    return ClockFlight(name="take-off, heads in a smooth loop", scenario=scenario, config=one_mode(psd))


def learned_clocks(
    flown: ClockFlight, names: Sequence[str], seeds: Sequence[int], biases: Sequence[str] = PAN_AND_TILT
) -> CalibrationErrors:
    """Learn clocks together with mount biases, 2 cm DGPS at every frame; the bound of the same tuning."""
    everything = (*biases, *names)
    prior = usual_prior(everything)
    config = replace(flown.config, calibration=CalibrationUse.ESTIMATE)
    errors, sigmas, bounds = [], [], []
    for seed in seeds:
        truth = drawn_parameters(prior, seed)
        flight = simulate(with_errors(flown.scenario(seed), everything, truth))
        start = drawn_start(flight, seed, *WIDE, lead_s=_START_LEAD_S)
        run = drive(flight, config, start, prior=prior, reference=lambda _: True)
        bound = full_bound(flight, config, start, prior=prior, truth=truth, reference=lambda _: True)
        errors.append(run.parameters - truth)
        sigmas.append(np.sqrt(np.diag(run.parameter_covariance)))
        bounds.append(np.sqrt(np.diag(bound[-1])[-len(everything) :]))
    return CalibrationErrors(names=everything, error=np.array(errors), sigma=np.array(sigmas), bound=np.array(bounds))


def _receiver(rate_hz: float) -> DgpsModel:
    return DgpsModel(rate_hz=rate_hz, sigma_m=np.full(3, DGPS_SIGMA_M))


def _above(scenario: Scenario, y_m: float) -> Callable[[DgpsFix], bool]:
    """Return what lets a reference in where the target truly is beyond a range."""
    return lambda fix: bool(scenario.trajectory.position(np.array([fix.t_s]))[0, 1] > y_m)


def _driven(scenario: Scenario, rate_hz: float) -> Scenario:
    """Return the scenario with heads that follow as real ones do, read at 50 Hz, and with a receiver."""
    ptu = PtuModel(pointing=SecondOrderLoop(), rate_hz=50.0)
    ptus = dict.fromkeys(scenario.ptus, ptu)
    return replace(scenario, ptus=ptus, dgps=_receiver(rate_hz))
