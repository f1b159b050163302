"""Tracks drawn from the filter's own motion model: its error against the bound and against its own covariance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from filter_flights.bounds import full_bound, joint_series, track_bound
from filter_flights.run_filter import Run, drawn_start, drive
from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.messages import Epoch, PixelMeasurement, PtuSample
from groundstation.rig.rig import Rig, Station
from groundstation.simulation import Scenario, SimulatedFlight, case_b, case_c, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.path_deviation import drawn_deviation
from groundstation.simulation.pointing import UncontrolledPointing
from groundstation.simulation.standard_cases import BOUND_PSD_M2_S3, drawn_glide

WIDE = (10.0, 5.0)
NEAR = (0.1, 0.3)
# heads that drift by it stay within some 30° of the target for an approach
DRAWN_HEAD_PSD_RAD2_S3 = 1e-5
_WIDE_IMAGE_PX = 16_000


def one_mode(psd: tuple[float, float, float] = BOUND_PSD_M2_S3) -> EstimationConfig:
    """Return the default tuning with one way of flying, of this PSD."""
    return replace(EstimationConfig(), acceleration_psd_m2_s3=psd, manoeuvre_psd_m2_s3=psd, detection_lasting_share=0.0)


def drawn_case(case: str, seed: int, rate_hz: float, nominal: GlideApproach | None = None) -> Scenario:
    """Return case "B" (white angles) or "C" on a flight drawn from the motion model."""
    flight = drawn_glide(seed, nominal=nominal)
    if case == "B":
        return case_b(seed=seed, rate_hz=rate_hz, trajectory=flight, white_encoder=True)
    return case_c(seed=seed, rate_hz=rate_hz, trajectory=flight)


def with_drawn_heads(plain: Scenario, seed: int, psd_rad2_s3: float = DRAWN_HEAD_PSD_RAD2_S3) -> Scenario:
    """Return the scenario with heads that move as the filter's model of them, too, and pictures that hold the target.

    Nothing turns such a head after the target, so the pictures are ± 50° wide; focal length and noise stay.
    """
    start, end = plain.trajectory.span_s

    def adrift(number: int) -> UncontrolledPointing:
        generator = np.random.default_rng([seed, 5, number])
        psd = (psd_rad2_s3, psd_rad2_s3, 0.0)
        span = (start - plain.lead_s - 1.0, end + plain.lead_s + 1.0)
        return UncontrolledPointing(deviation=drawn_deviation(generator, span_s=span, acceleration_psd_m2_s3=psd))

    def widened(station: Station) -> Station:
        middle = np.full(2, 0.5 * (_WIDE_IMAGE_PX - 1))
        lens = replace(station.lens, image_size_px=(_WIDE_IMAGE_PX, _WIDE_IMAGE_PX), principal_point_px=middle)
        return replace(station, lens=lens)

    rig = Rig(stations=tuple(widened(s) for s in plain.rig.stations))
    ptus = {name: replace(model, pointing=adrift(k)) for k, (name, model) in enumerate(plain.ptus.items())}
    return replace(plain, rig=rig, true_rig=rig, ptus=ptus)


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

    def refused(self) -> int:
        """Return how many pixels the gates refused."""
        return sum(r.refused for r in self.runs)


def chi2_range(dof: int, samples: int, share: float = 0.95) -> tuple[float, float]:
    """Return the two-sided range of the mean of ``samples`` χ² of ``dof``, per degree of freedom."""
    low, high = chi2.ppf([0.5 - 0.5 * share, 0.5 + 0.5 * share], dof * samples) / (dof * samples)
    return float(low), float(high)


def sample_case(case: str, rate_hz: float, seeds: Sequence[int], *, drawn_heads: bool = True) -> Sample:
    """Fly a case with many seeds, from the bounds' wide start.

    With ``drawn_heads`` everything is drawn from the filter's model, and the bound is that of the whole state; without,
    heads aim exactly, and the bound is that of independent pairs.
    """
    runs, bounds = [], []
    config = replace(one_mode(), ptu_acceleration_psd_rad2_s3=DRAWN_HEAD_PSD_RAD2_S3) if drawn_heads else one_mode()
    for seed in seeds:
        plain = drawn_case(case, seed, rate_hz)
        flight = simulate(with_drawn_heads(plain, seed) if drawn_heads else plain)
        start = drawn_start(flight, seed, *WIDE)
        runs.append(drive(flight, config, start))
        if drawn_heads:
            bound = full_bound(flight, config, start, prior=ParameterPrior.nothing(), truth=np.zeros(0))
        else:
            bound = track_bound(flight, BOUND_PSD_M2_S3, WIDE)
        bounds.append(np.diagonal(bound[:, :3, :3], axis1=1, axis2=2))
    return Sample(runs=runs, bound_m2=np.array(bounds))


def triangulated_errors(flight: SimulatedFlight) -> FloatArray:
    """Return the errors (n, 3) of the maximum-likelihood point of each pair, NaN without one."""
    geometries = {s.name: s.geometry() for s in flight.rig.stations}
    angles: dict[str, PtuSample] = {}
    views: list[TriangulationView] = []
    errors = np.full((flight.truth.t_s.size, 3), np.nan)
    for event in flight.events:
        if isinstance(event, PtuSample):
            angles[event.station] = event
        elif isinstance(event, PixelMeasurement):
            reading = angles[event.station]
            views.append(
                TriangulationView(
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
class AccuracyGain:
    """Ratio (3,) of the RMSE of triangulation to that of the filter, and the same ratio (3,) of the bounds."""

    filtered: FloatArray
    bound: FloatArray


def gain_over_triangulation(rate_hz: float, seeds: Sequence[int], start_y_m: float = 600.0) -> AccuracyGain:
    """Return the gain in case B: mean over ranges y of 40 … 450 m, in bins of 10 m of each flight's own.

    Flights begin at ``start_y_m`` with the near start: 600 m is where those of the bounds do. One that begins at 450 m
    has the start's own 0.1 m in its first bins, where triangulation has 2 m.
    """
    nominal = GlideApproach(start_y_m=start_y_m, end_y_m=40.0)
    edges = np.arange(40.0, 451.0, 10.0)
    sums, counts = np.zeros((4, edges.size - 1, 3)), np.zeros(edges.size - 1)
    for seed in seeds:
        flight = simulate(drawn_case("B", seed, rate_hz, nominal))
        triangulated = triangulated_errors(flight) ** 2
        y = flight.truth.position_runway_m[:, 1]
        used = np.flatnonzero((y >= edges[0]) & (y < edges[-1]) & np.isfinite(triangulated[:, 0]))
        fixed = np.linalg.inv(joint_series(flight)[used])
        squares = (
            drive(flight, one_mode(), drawn_start(flight, seed, *NEAR)).error[used, :3] ** 2,
            triangulated[used],
            np.diagonal(track_bound(flight, BOUND_PSD_M2_S3, NEAR)[used, :3, :3], axis1=1, axis2=2),
            np.diagonal(fixed, axis1=1, axis2=2),
        )
        where = np.digitize(y[used], edges) - 1
        np.add.at(counts, where, 1.0)
        for total, square in zip(sums, squares, strict=True):
            np.add.at(total, where, square)
    filtered, found, tracked, single = np.sqrt(sums / counts[:, None])
    return AccuracyGain(filtered=(found / filtered).mean(axis=0), bound=(single / tracked).mean(axis=0))


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
