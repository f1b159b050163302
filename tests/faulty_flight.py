"""Simulated flights of three (or more) stations in which one of them goes wrong midway."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from groundstation.evaluation.correlation import effective_count, lag_one
from groundstation.integrity.station_exclusion import IntegrityConfig
from groundstation.messages import CameraReport, Event, InitialState, PixelMeasurement, TrackEstimate, TrackEvent
from groundstation.rig.rig import Rig
from groundstation.simulation import FlightTruth, Scenario, SimulatedFlight, StationErrors, perturbed, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.detection_camera import CameraModel
from groundstation.simulation.standard_cases import STEP_RAD, case_b, drawn_glide, standard_rig, standard_station
from groundstation.simulation.trajectory import Trajectory
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

STATIONS = ("left", "right", "third")
FOURTH_M = (-40.0, 60.0)
PSD_M2_S3 = (1.0, 4.0, 2.0)


def rig_of(names: tuple[str, ...] = STATIONS) -> Rig:
    noise = {"resolution_rad": 0.0, "sigma_rad": STEP_RAD / 12**0.5}
    rig = standard_rig(third=True, **noise)
    fourth = standard_station("fourth", *FOURTH_M, **noise)
    return Rig(stations=tuple(s for s in (*rig.stations, fourth) if s.name in names))


def scenario(
    seed: int,
    names: tuple[str, ...] = STATIONS,
    trajectory: Trajectory | None = None,
    camera: CameraModel | None = None,
    ptu_hz: float | None = None,
) -> Scenario:
    path = GlideApproach(start_y_m=400.0, end_y_m=150.0) if trajectory is None else trajectory
    base = case_b(seed=seed, trajectory=path, ptu_hz=ptu_hz)
    rig = rig_of(names)
    model = base.cameras["left"] if camera is None else camera
    ptu = base.ptus["left"]
    return replace(
        base, true_rig=rig, rig=rig, ptus=dict.fromkeys(names, ptu), cameras=dict.fromkeys(names, model), seed=seed
    )


def broken(healthy: Scenario, errors: dict[str, StationErrors], from_s: float) -> SimulatedFlight:
    """The same flight and draws, the true rig another from ``from_s`` on (a bump; the user's rig stays)."""
    before = simulate(healthy)
    after = simulate(replace(healthy, true_rig=perturbed(healthy.true_rig, errors)))
    events = [e for e in before.events if e.t_s < from_s] + [e for e in after.events if e.t_s >= from_s]
    return replace(before, events=tuple(events))


@dataclass
class PollStatistics:
    truth: FlightTruth
    pipeline: Pipeline
    cameras: list[CameraReport] = field(default_factory=list)
    estimates: list[TrackEstimate] = field(default_factory=list)
    events: list[TrackEvent] = field(default_factory=list)

    def rmse(self, from_s: float, to_s: float = 1e9) -> np.ndarray:
        return np.sqrt(np.mean([self._error(e) ** 2 for e in self._within(from_s, to_s)], axis=0))

    def white(self, from_s: float, to_s: float = 1e9) -> np.ndarray:
        """Errors (n, 3) of the position over the root of their stated covariance."""
        return np.array(
            [
                np.linalg.solve(np.linalg.cholesky(e.kinematics.covariance[:3, :3]), self._error(e))
                for e in self._within(from_s, to_s)
            ]
        )

    def anees(self, from_s: float, to_s: float = 1e9) -> float:
        return float(np.mean(self.white(from_s, to_s) ** 2))

    def reported(self, words: str) -> list[TrackEvent]:
        return [e for e in self.events if words in e.text]

    def _within(self, from_s: float, to_s: float) -> list[TrackEstimate]:
        return [e for e in self.estimates if e.kinematics is not None and from_s <= e.t_s < to_s]

    def _error(self, e: TrackEstimate) -> np.ndarray:
        return e.kinematics.position_runway_m - self.truth.position_runway_m[e.epoch]


def drawn_path(seed: int, start_y_m: float = 400.0, end_y_m: float = 150.0) -> Trajectory:
    """A glide driven by the white acceleration that `watch` supposes: only of such is the covariance to be right."""
    return drawn_glide(seed, PSD_M2_S3, GlideApproach(start_y_m=start_y_m, end_y_m=end_y_m))


@dataclass(frozen=True, kw_only=True)
class Consistency:
    """Mean square of whitened errors per degree of freedom, and its two-sided 99.8 % χ² bounds.

    The bounds are those of as many independent errors as the correlation from epoch to epoch leaves.
    """

    mean: float
    low: float
    high: float

    @property
    def right(self) -> bool:
        return self.low < self.mean < self.high


def consistency(flights: list[PollStatistics], from_s: float, to_s: float = 1e9) -> Consistency:
    runs = [flight.white(from_s, to_s) for flight in flights]
    dof = 3 * effective_count(sum(map(len, runs)), lag_one(runs))
    low, high = chi2.ppf([0.001, 0.999], dof) / dof
    return Consistency(mean=float(np.mean(np.concatenate(runs) ** 2)), low=float(low), high=float(high))


def watch(
    flight: SimulatedFlight,
    integrity: IntegrityConfig | None = None,
    psd: tuple[float, float, float] = PSD_M2_S3,
    events: list[Event] | None = None,
    start: np.random.Generator | None = None,
) -> PollStatistics:
    """Run a flight; it begins with the truth, or with what ``start`` draws about it by the stated sigmas."""
    base = Config()
    tuned = replace(
        base.estimation,
        labelled_sigma_px=0.5,
        fix_window_s=0.005,
        acceleration_psd_m2_s3=psd,
        manoeuvre_psd_m2_s3=psd,
    )
    config = replace(base, estimation=tuned, integrity=IntegrityConfig() if integrity is None else integrity)
    off = np.zeros((2, 3)) if start is None else start.normal(size=(2, 3))
    initial = InitialState(
        t_s=float(flight.truth.t_s[0]),
        position_runway_m=flight.truth.position_runway_m[0] + off[0],
        velocity_runway_m_s=flight.truth.velocity_runway_m_s[0] + off[1],
        sigma_position_m=np.full(3, 1.0),
        sigma_velocity_m_s=np.full(3, 1.0),
    )
    pipeline = Pipeline(flight.rig, config, span_m=2.3, initial=initial)
    out = PollStatistics(truth=flight.truth, pipeline=pipeline)
    for event in flight.events if events is None else events:
        report = pipeline.step(event)
        out.cameras += report.cameras
        out.estimates += report.estimates
        out.events += report.events
    report = pipeline.finish()
    out.estimates += report.estimates
    out.cameras += report.cameras
    return out


def without(flight: SimulatedFlight, gone: dict[str, tuple[float, float]]) -> list[Event]:
    """The flight's events less the pixels of some stations within some time."""

    def silent(e: Event) -> bool:
        return (
            isinstance(e, PixelMeasurement) and e.station in gone and gone[e.station][0] <= e.t_s < gone[e.station][1]
        )

    return [e for e in flight.events if not silent(e)]
