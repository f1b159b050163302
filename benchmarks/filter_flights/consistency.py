"""Tracks drawn from the filter's own motion model: its error against the bound and against its own covariance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from filter_flights.bounds import joint_series, track_bound
from filter_flights.drive import Run, drawn_start, drive
from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.messages import Epoch, PixelMeasurement, PtuSample
from groundstation.simulation import Scenario, SimulatedFlight, case_b, case_c, simulate
from groundstation.simulation.approach import Glide
from groundstation.simulation.cases import BOUND_PSD_M2_S3, drawn_glide
from groundstation.triangulation import View, triangulate

WIDE = (10.0, 5.0)
NEAR = (0.1, 0.3)


def one_mode(psd: tuple[float, float, float] = BOUND_PSD_M2_S3) -> EstimationConfig:
    """Return the default tuning with one way of flying, of this PSD."""
    return replace(EstimationConfig(), acceleration_psd_m2_s3=psd, manoeuvre_psd_m2_s3=psd, detection_lasting_share=0.0)


def drawn_case(case: str, seed: int, rate_hz: float, nominal: Glide | None = None) -> Scenario:
    """Return case "B" (white angles) or "C" on a flight drawn from the motion model."""
    flight = drawn_glide(seed, nominal=nominal)
    if case == "B":
        return case_b(seed=seed, rate_hz=rate_hz, trajectory=flight, white_encoder=True)
    return case_c(seed=seed, rate_hz=rate_hz, trajectory=flight)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample:
    """Runs of one case, flown along the same nominal: ``runs``, and the bound's variances (r, n, 3) in m²."""

    runs: Sequence[Run]
    bound_m2: FloatArray

    @property
    def y_m(self) -> FloatArray:
        """Mean y (n,) of each epoch."""
        return np.asarray(np.mean([r.truth[:, 1] for r in self.runs], axis=0))

    def epoch_at(self, y_m: float) -> int:
        """Return the epoch that is nearest to a range."""
        return int(np.argmin(np.abs(self.y_m - y_m)))

    def rmse_over_bound(self, low_m: float, high_m: float) -> FloatArray:
        """Return RMSE / bound (3,), both over all epochs of a bin of ranges, variances averaged."""
        inside = (self.y_m >= low_m) & (self.y_m < high_m)
        squares = np.array([r.error[inside, :3] ** 2 for r in self.runs])
        return np.asarray(np.sqrt(squares.mean(axis=(0, 1)) / self.bound_m2[:, inside].mean(axis=(0, 1))))

    def rmse(self, y_m: float) -> FloatArray:
        """Return the RMSE (3,) at the epoch nearest to a range."""
        k = self.epoch_at(y_m)
        return np.asarray(np.sqrt(np.mean([r.error[k, :3] ** 2 for r in self.runs], axis=0)))

    def anees(self, y_m: float, count: int = 3) -> float:
        """Return the mean normalised error square per degree of freedom at one epoch: runs are independent."""
        k = self.epoch_at(y_m)
        return float(np.mean([r.nees(count)[k] for r in self.runs])) / count

    def nis(self) -> float:
        """Return the mean NIS per degree of freedom; innovations are white, so all count."""
        return float(np.concatenate([r.nis for r in self.runs]).mean()) / 2.0

    def nis_count(self) -> int:
        """Return how many innovations there are."""
        return sum(r.nis.size for r in self.runs)


def chi2_range(dof: int, samples: int, share: float = 0.95) -> tuple[float, float]:
    """Return the two-sided range of the mean of ``samples`` χ² of ``dof``, per degree of freedom."""
    low, high = chi2.ppf([0.5 - 0.5 * share, 0.5 + 0.5 * share], dof * samples) / (dof * samples)
    return float(low), float(high)


def sample_case(case: str, rate_hz: float, seeds: Sequence[int], config: EstimationConfig | None = None) -> Sample:
    """Fly a case with many seeds, from the bounds' wide start."""
    runs, bounds = [], []
    for seed in seeds:
        flight = simulate(drawn_case(case, seed, rate_hz))
        runs.append(drive(flight, one_mode() if config is None else config, drawn_start(flight, seed, *WIDE)))
        bound = track_bound(flight, BOUND_PSD_M2_S3, WIDE)
        bounds.append(np.diagonal(bound[:, :3, :3], axis1=1, axis2=2))
    return Sample(runs=runs, bound_m2=np.array(bounds))


def triangulated_errors(flight: SimulatedFlight) -> FloatArray:
    """Return the errors (n, 3) of the maximum-likelihood point of each pair, NaN where there is none."""
    geometries = {s.name: s.geometry() for s in flight.rig.stations}
    angles: dict[str, PtuSample] = {}
    views: list[View] = []
    errors = np.full((flight.truth.t_s.size, 3), np.nan)
    for event in flight.events:
        if isinstance(event, PtuSample):
            angles[event.station] = event
        elif isinstance(event, PixelMeasurement):
            reading = angles[event.station]
            views.append(
                View(
                    station=geometries[event.station],
                    pixel=np.array([event.u_px, event.v_px]),
                    covariance_px2=flight.scenario.cameras[event.station].pixel_covariance_px2,
                    pan_rad=reading.pan_rad,
                    tilt_rad=reading.tilt_rad,
                    angle_sigma_rad=flight.rig[event.station].angle_sigma_rad,
                )
            )
        elif isinstance(event, Epoch):
            fix = triangulate(views) if len(views) > 1 else None
            if fix is not None:
                errors[event.epoch] = fix.point_runway_m - flight.truth.position_runway_m[event.epoch]
            views = []
    return errors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gain:
    """How many times smaller than triangulation's the filter's RMSE is (3,), and the bounds' own ratio (3,)."""

    filtered: FloatArray
    bound: FloatArray


def gain_over_triangulation(rate_hz: float, seeds: Sequence[int]) -> Gain:
    """Return the gain in case B, from the near start: mean over epochs of y 40 … 450 m."""
    nominal = Glide(start_y_m=450.0, end_y_m=40.0)
    filtered, triangulated, tracked, fixed = [], [], [], []
    for seed in seeds:
        flight = simulate(drawn_case("B", seed, rate_hz, nominal))
        filtered.append(drive(flight, one_mode(), drawn_start(flight, seed, *NEAR)).error[:, :3] ** 2)
        triangulated.append(triangulated_errors(flight) ** 2)
        bound = track_bound(flight, BOUND_PSD_M2_S3, NEAR)
        tracked.append(np.diagonal(bound[:, :3, :3], axis1=1, axis2=2))
        fixed.append(np.diagonal(np.linalg.inv(joint_series(flight)), axis1=1, axis2=2))
    ratio = np.sqrt(np.nanmean(triangulated, axis=0) / np.mean(filtered, axis=0))
    best = np.sqrt(np.mean(fixed, axis=0) / np.mean(tracked, axis=0))
    return Gain(filtered=np.asarray(ratio.mean(axis=0)), bound=np.asarray(best.mean(axis=0)))


def outlier_ratio(rate_hz: float, seeds: Sequence[int], share: float = 0.05) -> FloatArray:
    """Return the RMSE (2, 3) with gross outliers within ±50 px over that without them: near start, wide start.

    Over all epochs below y = 450 m.
    """
    ratios = []
    for sigmas in (NEAR, WIDE):
        squares: list[list[FloatArray]] = [[], []]
        for seed in seeds:
            plain = drawn_case("B", seed, rate_hz)
            cameras = {name: replace(c, outlier_probability=share) for name, c in plain.cameras.items()}
            for k, scenario in enumerate((plain, replace(plain, cameras=cameras))):
                flight = simulate(scenario)
                run = drive(flight, one_mode(), drawn_start(flight, seed, *sigmas))
                squares[k].append(run.error[run.truth[:, 1] < 450.0, :3] ** 2)
        clean, dirty = (np.concatenate(s).mean(axis=0) for s in squares)
        ratios.append(np.sqrt(dirty / clean))
    return np.array(ratios)
