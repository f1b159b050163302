"""`calibrate flight` on drawn rigs: errors over stated sigmas, relative pan, tilt, and clocks against their bound.

usage: python benchmarks/calibration_rigs.py [--rigs N] [--first SEED] [--no-bounds] [--workers N] [CASE …]

Cases, simulated at the level of angles and pixels, 2 cm DGPS at 10 Hz over the whole approach, all biases free:
`mounts`: mounts off by 0.05° about each axis (1 sigma, as the rig admits), the log's clock by 0.2 s, case B;
`gnss`: mounts, by a receiver without corrections: 0.3/0.3/0.45 m of each fix, 0.95/0.95/1.43 m that last for 60 s;
`clocks`: mounts, too, and clocks of cameras and PTUs off by 20 ms each, heads that lag behind a weaving approach;
`all`: all that `--free` can name: those and positions, boresights, lenses, drifts, shutters and the antenna's position.
`slow20`, `slow10`: as `clocks`, but readings at 20 Hz, or at 10 Hz, at the exposures; `gaps`: of the readings of
`clocks` 12 % are missing, at random. The method for these was developed with some of their seeds in view.
Each error's square over its stated variance has mean 1 over rigs where the sigmas are true; the bounds are those of
chi-square. Bounds are (JᵀWJ + prior)⁻¹ of the noise that was put in, at the true rig, path and angles (the same flight
without noise); paths of aircraft and heads are constrained by their samples and smoothness, as found by the fit.
Cameras' directions are base and boresight together, at places on the flight; each of the two alone is less certain.
Figures in docs/notes/calibration.md.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from drawn_pointing import GROUPS, PointingErrors, pointing_errors
from drawn_rigs import CLOCK_S, draw, errors, loops, pointing_deviation, unit_of
from parallel_study import StudyRun, add_study_arguments, as_json
from scipy.stats import chi2

from calibration.flight.calibrate import FlightRequest, calibrate_flight
from calibration.flight.fit import FlightFit
from calibration.flight.observations import FlightData, gather_flight
from calibration.flight.path_parts import path_samples
from calibration.flight.paths import PathResiduals
from calibration.flight.problem import FlightProblem
from groundstation.session import load_session
from groundstation.simulation import Scenario, case_b, simulate
from groundstation.simulation.approach import weaving_approach
from groundstation.simulation.detection_camera import CameraModel, isotropic
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.pointing import DisturbedPointing, FirstOrderLoop
from groundstation.simulation.session_folder import write_session_folder

CASES = ("mounts", "gnss", "clocks", "slow20", "slow10", "gaps", "all")
FREE = {
    **dict.fromkeys(("mounts", "gnss", "clocks", "slow20", "slow10", "gaps"), "orientation"),
    "all": "orientation,position,boresight,lens,drift,readout,antenna",
}
# the pixels' noise in case B, px; and a negligible noise
PIXEL_PX = 0.5
_NOTHING = 1e-7
# what chance leaves outside the bounds, both sides together
CHANCE = 1e-3
_DRAWS = 77
# readings per s where a loop holds the craft; None: one at each exposure, 10 Hz
_PTU_HZ = {"clocks": 50.0, "slow20": 20.0, "slow10": None, "gaps": 50.0}
_MISSING = 0.12
# a receiver without corrections, m; together 1/1/1.5
_GNSS_WHITE_M, _GNSS_LASTING_M = np.array([0.3, 0.3, 0.45]), np.array([0.954, 0.954, 1.431])
# cases whose log has a clock of its own
_FREE_LOG_CLOCK = ("mounts", "gnss")
# flight areas of `all` and of the others: cameras' directions are evaluated at places there, m
_PLACES_M = {
    "all": np.array([(-55.0, 130.0, 32.0), (0.0, 130.0, 32.0), (55.0, 130.0, 32.0)]),
    "approach": np.array([(0.0, 300.0, 20.0), (0.0, 200.0, 14.0), (0.0, 100.0, 8.0)]),
}
_CLOCKS = "\n[clocks]\ndgps = {{ offset_s = 0.0 }}\ndetections = {{ offset_s = 0.0, sigma_s = {sigma} }}\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class RigErrors:
    """One rig's p errors after calibration, their stated sigmas (p,), bounds (p,) on request; 1 sigma each.

    ``together`` is eᵀC⁻¹e of all of them; ``pointing`` the cameras' directions, by the included parameters.
    """

    names: tuple[str, ...]
    error: np.ndarray
    sigma: np.ndarray
    bound: np.ndarray | None
    together: float
    pointing: dict[str, PointingErrors]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """What n rigs of one case gave; (n, p) each, ``together`` (n,)."""

    names: tuple[str, ...]
    error: np.ndarray
    sigma: np.ndarray
    bound: np.ndarray | None
    together: np.ndarray
    pointing: tuple[dict[str, PointingErrors], ...]

    def normalised(self) -> np.ndarray:
        """Return the mean square of error over claimed sigma, (p,)."""
        return np.mean((self.error / self.sigma) ** 2, axis=0)

    def over_bound(self) -> np.ndarray:
        """Return the rms error over the bound, (p,)."""
        if self.bound is None:
            raise ValueError("got a sample without bounds; wanted sample(…, bounded=True)")
        return np.sqrt(np.mean(self.error**2, axis=0) / np.mean(self.bound**2, axis=0))

    def degrees(self, name: str) -> np.ndarray:
        """Return a rotation's errors (n,) in degrees."""
        return np.degrees(self.error[:, self.names.index(name)])

    def limits(self) -> tuple[float, float]:
        """Return what mean squares of n true sigmas stay within."""
        n = len(self.error)
        return float(chi2.ppf(0.5 * CHANCE, n) / n), float(chi2.ppf(1.0 - 0.5 * CHANCE, n) / n)


def sample(case: str, seeds: Sequence[int], *, bounded: bool = True) -> Sample:
    """Calibrate one rig for each seed; the bounds, which take a third of the time, if ``bounded``."""
    return pooled([one_rig(case, seed, bounded=bounded) for seed in seeds])


def pooled(found: Sequence[RigErrors]) -> Sample:
    """Return what all rigs of one case gave."""
    bounds = [f.bound for f in found if f.bound is not None]
    return Sample(
        names=found[0].names,
        error=np.array([f.error for f in found]),
        sigma=np.array([f.sigma for f in found]),
        bound=np.array(bounds) if bounds else None,
        together=np.array([f.together for f in found]),
        pointing=tuple(f.pointing for f in found),
    )


def rig_as_json(job: tuple[str, int, bool]) -> Any:
    """Return one rig's errors as JSON has them; ``job`` is case, seed, and whether with bounds."""
    case, seed, bounded = job
    return as_json(one_rig(case, seed, bounded=bounded))


def rig_from_json(value: dict[str, Any]) -> RigErrors:
    """Return a rig's errors from what `rig_as_json` returns."""
    arrays = {key: np.array(value[key]) for key in ("error", "sigma", "bound") if value[key] is not None}
    pointing = {k: PointingErrors(**{n: np.array(a) for n, a in own.items()}) for k, own in value["pointing"].items()}
    return RigErrors(**value | arrays | {"names": tuple(value["names"]), "pointing": pointing})


def one_rig(case: str, seed: int, *, bounded: bool = True) -> RigErrors:
    """Draw a rig's errors, fly, calibrate, compare."""
    scenario = _scenario(case, seed)
    drawn = draw(scenario.rig, case, np.random.default_rng([_DRAWS, seed]))
    dgps = DgpsModel(clock_offset_s=drawn.late_s, antenna_in_body_m=drawn.antenna_m)
    if case == "gnss":
        dgps = replace(dgps, sigma_m=_GNSS_WHITE_M, wander_sigma_m=_GNSS_LASTING_M)
    scenario = replace(scenario, rig=drawn.stated, true_rig=drawn.true, dgps=dgps)
    with tempfile.TemporaryDirectory() as folder:
        session, quiet = Path(folder) / "session", Path(folder) / "quiet"
        flights = ((session, scenario), (quiet, without_noise(scenario)))
        for path, flown in flights if bounded else flights[:1]:
            # the session has no position of the antenna
            seen = replace(simulate(flown), scenario=replace(flown, dgps=DgpsModel()))
            write_session_folder(path, seen, name="simulated")
            if case == "gaps":
                _lose_readings(path / "ptu.csv", seed)
            if case not in _FREE_LOG_CLOCK:
                about = path / "session.toml"
                about.write_text(about.read_text() + _CLOCKS.format(sigma=CLOCK_S))
        request = FlightRequest(session=session, out=Path(folder) / "rig.toml", free=FREE[case])
        found = calibrate_flight(request)
        exact = gather_flight(load_session(quiet), None, None, None) if bounded else None
    error = errors(found.fit, found.rig, drawn)
    names = found.fit.problem.names
    return RigErrors(
        names=names,
        error=error,
        sigma=found.fit.sigma,
        bound=None if exact is None else _bound(found.fit, exact, error + found.fit.change),
        together=float(error @ np.linalg.solve(found.fit.covariance, error)),
        pointing=pointing_errors(found.fit, found.rig, error, _PLACES_M.get(case, _PLACES_M["approach"])),
    )


def _lose_readings(path: Path, seed: int) -> None:
    """Take rows out of a table of readings, the same ones for the same seed."""
    head, *rows = path.read_text().splitlines()
    there = np.random.default_rng([_DRAWS, seed, 1]).random(len(rows)) >= _MISSING
    path.write_text("\n".join([head, *(row for row, kept in zip(rows, there, strict=True) if kept)]) + "\n")


def without_noise(scenario: Scenario) -> Scenario:
    """Return the same flight and rigs, read, seen and fixed without noise; sigmas of nothing cannot be written."""
    quiet: dict[str, Any] = {"ptu_resolution_rad": 0.0, "ptu_sigma_rad": _NOTHING}
    rigs = (
        replace(rig, stations=tuple(replace(s, **quiet) for s in rig.stations))
        for rig in (scenario.rig, scenario.true_rig)
    )
    rig, true = rigs
    return replace(
        scenario,
        rig=rig,
        true_rig=true,
        cameras=dict.fromkeys(rig.names, CameraModel(pixel_covariance_px2=isotropic(_NOTHING))),
        dgps=replace(scenario.dgps, sigma_m=np.full(3, 1e-4), wander_sigma_m=np.zeros(3)),
    )


def bounding(fit: FlightFit, exact: FlightData, true_change: np.ndarray) -> PathResiduals:
    """Return the residuals of the given noise, with the derivatives of the flight without noise."""
    track = exact.track.pointed(fit.problem.antenna_m(true_change))
    problem = replace(fit.problem, observations=exact.observations, track=track)
    parts = tuple(
        replace(
            noisy,
            t_s=quiet.t_s,
            samples=quiet.samples,
            sigma=np.broadcast_to(noisy.sigma[0], quiet.samples.shape),
            smoothness=tuple(
                s if noisy.lasting is not None else replace(s, noise_factor=1.0) for s in noisy.smoothness
            ),
        )
        for noisy, quiet in zip(fit.parts, path_samples(problem), strict=True)
    )
    usable = {name: problem.predict(name, true_change).usable for name in exact.observations}
    factors = {name: _noise_put_in(problem, name, true_change) for name in exact.observations}
    return PathResiduals(problem, factors, usable, true_change, parts)


def _bound(fit: FlightFit, exact: FlightData, true_change: np.ndarray) -> np.ndarray:
    """Return one sigma (p,) that the noise put in allows."""
    information = bounding(fit, exact, true_change).fit_problem().linearise(true_change).information
    return np.sqrt(np.diag(np.linalg.inv(information)))


def _noise_put_in(problem: FlightProblem, name: str, change: np.ndarray) -> float:
    """Return a station's noise over assumed: of its pixels, and of the angles that no path absorbs."""
    assumed = float(np.mean(problem.observations[name].sigma_px ** 2))
    whole = float(np.median(np.einsum("nii->n", problem.predict(name, change).own_px2))) / 2.0
    return float(np.sqrt((whole - assumed + PIXEL_PX**2) / whole))


def _scenario(case: str, seed: int) -> Scenario:
    if case in _FREE_LOG_CLOCK:
        return case_b(seed=seed)
    if case == "all":
        pointing = DisturbedPointing(deviation=pointing_deviation())
        return case_b(seed=seed, trajectory=loops(), pointing=pointing, ptu_hz=32.0)
    return case_b(seed=seed, trajectory=weaving_approach(), pointing=FirstOrderLoop(), ptu_hz=_PTU_HZ[case])


def show(case: str, found: Sample) -> None:
    """Print each parameter's rms error, stated sigma, bound and chi-square, and the aims for all rigs."""
    rigs, p = found.error.shape
    low, high = found.limits()
    print(f"{case}, {rigs} rigs; mean square of error over sigma, {1 - CHANCE:.1%} of such: {low:.2f} to {high:.2f}")
    known = (found.error, found.sigma) if found.bound is None else (found.error, found.sigma, found.bound)
    each = [np.sqrt(np.mean(v**2, axis=0)) for v in known]
    for k, name in enumerate(found.names):
        unit, scale = unit_of(name)
        numbers = " ".join(f"{scale * v[k]:.5g}" for v in each)
        square = found.normalised()[k]
        print(f"  {name:<28} rms, sigma, bound {numbers} {unit}; {square:.2f}", end="; ")
        ratio = "no bound" if found.bound is None else f"rms/bound {found.over_bound()[k]:.2f}"
        print(ratio + ("" if low <= square <= high else "  OUTSIDE"))
    least, most = chi2.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], rigs * p) / rigs
    print(f"  all together {np.mean(found.together):.2f} of {p}, {least:.2f} to {most:.2f}")
    pan = found.degrees("left.runway_from_base.z") - found.degrees("right.runway_from_base.z")
    tilt = np.concatenate([found.degrees(f"{name}.runway_from_base.x") for name in ("left", "right")])
    for label, values in (("relative pan", pan), ("tilt", tilt)):
        print(f"  {label}: rms {np.sqrt(np.mean(values**2)):.5f}, worst {np.abs(values).max():.5f} deg", flush=True)
    show_pointing(found)


def show_pointing(found: Sample) -> None:
    """Print the cameras' errors of direction at places of the flight, relative to each other and in tilt."""
    n = len(found.pointing)
    for group in GROUPS:
        own = [pointing[group] for pointing in found.pointing]
        off = np.degrees([pointing.error for pointing in own])
        sigma = np.degrees(np.sqrt([np.einsum("pii->pi", pointing.covariance) for pointing in own]))
        square = np.mean([pointing.together() for pointing in own])
        low, high = chi2.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], 2 * n) / n
        print(f"  where they look, {group}: relative pan and tilt eᵀC⁻¹e {square:.2f} of 2, {low:.2f} to {high:.2f}")
        for label, columns in (("relative pan", [0]), ("relative tilt", [1]), ("tilt", [2, 3])):
            values, claimed = off[:, :, columns], sigma[:, :, columns]
            rms, reported = np.sqrt(np.mean(values**2)), np.sqrt(np.mean(claimed**2))
            print(f"    {label}: rms {rms:.5f}, worst {np.abs(values).max():.5f}, sigma {reported:.5f} deg", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first rig's seed")
    parser.add_argument("--no-bounds", action="store_true", help="without the bounds, a third of the time")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"{', '.join(CASES)}; or all seven")
    add_study_arguments(parser, "calibration-rigs")
    options = parser.parse_args()
    cases = options.cases or CASES
    seeds = range(options.first, options.first + options.rigs)
    jobs = {f"{case}-{seed}": (case, seed, not options.no_bounds) for case in cases for seed in seeds}
    found = StudyRun.chosen("calibration rigs", options).values(rig_as_json, jobs)
    for case in cases:
        show(case, pooled([rig_from_json(found[f"{case}-{seed}"]) for seed in seeds]))


if __name__ == "__main__":
    main()
