"""The same flights through the whole pipeline, with its ordering and synchronisation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from filter_flights.bounds import track_bound
from filter_flights.consistency import NEAR, Sample, drawn_case, one_mode
from filter_flights.run_filter import Run, drawn_start, true_states
from groundstation.messages import InitialState
from groundstation.simulation import SimulatedFlight, simulate
from groundstation.simulation.standard_cases import BOUND_PSD_M2_S3
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline


def sample_case_b(seeds: Sequence[int]) -> Sample:
    """Fly case B at 10 Hz from the near start."""
    runs, bounds = [], []
    for seed in seeds:
        flight = simulate(drawn_case("B", seed, 10.0))
        runs.append(_run(flight, seed))
        bound = track_bound(flight, BOUND_PSD_M2_S3, NEAR)
        bounds.append(np.diagonal(bound[:, :3, :3], axis1=1, axis2=2))
    return Sample(runs=runs, bound_m2=np.array(bounds))


def _run(flight: SimulatedFlight, seed: int) -> Run:
    start = drawn_start(flight, seed, *NEAR)
    initial = InitialState(
        t_s=start.t_s,
        position_runway_m=start.mean[:3],
        velocity_runway_m_s=start.mean[3:],
        sigma_position_m=np.full(3, NEAR[0]),
        sigma_velocity_m_s=np.full(3, NEAR[1]),
    )
    tuning = replace(one_mode(), labelled_sigma_px=0.5, fix_window_s=0.005)
    pipeline = Pipeline(flight.rig, replace(Config(), estimation=tuning), initial=initial)
    reports = [*(pipeline.step(event) for event in flight.events), pipeline.finish()]
    innovations = [(c.t_s, c.innovation) for r in reports for c in r.cameras if c.innovation is not None]
    answers = [(e.t_s, e.kinematics) for r in reports for e in r.estimates if e.kinematics is not None]
    t = np.array([at for at, _ in answers])
    truth = true_states(flight, t)
    found = np.array([np.hstack([k.position_runway_m, k.velocity_runway_m_s]) for _, k in answers])
    return Run(
        t_s=t,
        truth=truth,
        error=found - truth,
        covariance=np.array([k.covariance for _, k in answers]),
        nis=np.array([i.nis for _, i in innovations]),
        nis_s=np.array([at for at, _ in innovations]),
        refused=sum(not i.accepted for _, i in innovations),
        parameters=np.zeros(0),
        parameter_covariance=np.zeros((0, 0)),
        manoeuvring=np.zeros(len(answers)),
    )
