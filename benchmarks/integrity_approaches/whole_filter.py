"""The same approaches and faults through the whole pipeline, its reports fed to `ApproachIntegrity`."""

from dataclasses import replace
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.integrity.approach_advice import AdviceLevel
from groundstation.integrity.approach_integrity import ApproachIntegrity, ApproachIntegrityConfig
from groundstation.messages import Event, InitialState, PixelMeasurement
from groundstation.simulation import Scenario, SimulatedFlight, case_b, simulate
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from integrity_approaches.fault_list import SITE, SITES, SPAN_M
from integrity_approaches.linear_approach import (
    PATH,
    PIXEL_SIGMA_PX,
    DrawnFaults,
    LinearApproach,
    largest_share,
    lasting_share,
)
from integrity_approaches.strata import approach_of, drawn, stratum_of

# times that are compared: the last ten seconds, after the filter has settled
_COMPARED_S = 10.0


def compared(job: tuple[str, str, list[int]]) -> list[dict[str, Any]]:
    """Return what the pipeline and the linear approach make of each of these draws: site, kind, seeds."""
    site, name, seeds = job
    approach, stratum = approach_of(site), stratum_of(site, name)
    rows = []
    for seed in seeds:
        faults = drawn(site, stratum, np.random.default_rng([seed, 7]), 1).faults
        alike = approach.fly(np.random.default_rng([seed, 8]), faults)
        late = approach.t_s >= approach.t_s[-1] - _COMPARED_S
        linear = largest_share(alike.error_m, approach.level_m)[0, late]
        found = _flown(approach, faults, seed)
        rows.append(
            {
                "linear": {
                    "alarmed": bool(alike.alarmed[0]),
                    "misleading": float(alike.misleading[0]),
                    "exceeding": float(alike.exceeding[0]),
                    "share": float(np.sqrt((linear**2).mean())),
                },
                "pipeline": found,
            }
        )
    return rows


def _scenario(approach: LinearApproach, seed: int) -> Scenario:
    base = case_b(seed=seed, trajectory=PATH, white_encoder=True)
    rig = approach.site.rig
    ptu, camera = base.ptus["left"], base.cameras["left"]
    return replace(
        base, true_rig=rig, rig=rig, ptus=dict.fromkeys(rig.names, ptu), cameras=dict.fromkeys(rig.names, camera)
    )


def _faulty_events(approach: LinearApproach, flight: SimulatedFlight, faults: DrawnFaults, seed: int) -> list[Event]:
    """Return the flight's events, the pixels moved by calibration errors and by the fault."""
    rng = np.random.default_rng([seed, 9])
    c = rng.normal(size=approach.rows[0].by_calibration.shape[1])
    parameters = faults.parameters[0].reshape(-1)
    events: list[Event] = []
    for event in flight.events:
        if not isinstance(event, PixelMeasurement):
            events.append(event)
            continue
        rows = approach.rows[event.epoch]
        names = [look.station for look in approach.looks(event.epoch)]
        place = 2 * names.index(event.station)
        if place >= len(rows.residual):
            continue
        share = float(faults.share_at(event.t_s)[0])
        moved = rows.by_calibration @ c + share * rows.by_fault.reshape(len(rows.residual), -1) @ parameters
        u, v = (float(x) for x in moved[place : place + 2])
        events.append(replace(event, u_px=event.u_px + u, v_px=event.v_px + v))
    return events


def _flown(approach: LinearApproach, faults: DrawnFaults, seed: int) -> dict[str, Any]:
    """Return the outcome of one flight through the pipeline."""
    flight = simulate(_scenario(approach, seed))
    truth, base = flight.truth, Config()
    rng = np.random.default_rng([seed, 10])
    start = InitialState(
        t_s=float(truth.t_s[0]),
        position_runway_m=truth.position_runway_m[0] + rng.normal(size=3),
        velocity_runway_m_s=truth.velocity_runway_m_s[0] + rng.normal(size=3),
        sigma_position_m=np.ones(3),
        sigma_velocity_m_s=np.ones(3),
    )
    tuned = replace(base.estimation, labelled_sigma_px=PIXEL_SIGMA_PX, fix_window_s=0.005)
    pipeline = Pipeline(flight.rig, replace(base, estimation=tuned), span_m=SPAN_M, initial=start)
    config = ApproachIntegrityConfig(protection=SITES[approach.site.name].config)
    integrity = ApproachIntegrity(flight.rig, SITE, config, span_m=SPAN_M)
    epochs = len(approach.t_s)
    error, level = np.zeros((1, epochs, 3)), np.full((epochs, 3), np.inf)
    go, alarm_s = np.zeros((1, epochs), dtype=bool), np.inf
    for event in _faulty_events(approach, flight, faults, seed):
        report = pipeline.step(event)
        integrity.take(report, event.t_s)
        for estimate in report.estimates:
            if estimate.kinematics is None or integrity.advice is None or estimate.epoch >= epochs:
                continue
            known, k = estimate.kinematics, estimate.epoch
            off = known.position_runway_m - approach.position_m[k]
            error[0, k] = SITE.runway.axes() @ off
            go[0, k] = integrity.advice.level is AdviceLevel.GO
            found = integrity.advice.levels
            if found is not None:
                level[k] = (found.along_m, found.lateral_m, found.vertical_m)
                if found.fault_detected:
                    alarm_s = min(alarm_s, estimate.t_s)
    return _summary(approach, error, level, go, alarm_s)


def _summary(approach: LinearApproach, error: FloatArray, level: FloatArray, go: Any, alarm_s: float) -> dict[str, Any]:
    """Return the figures that both ways of flying have."""
    quiet = approach.t_s < alarm_s
    shares = largest_share(error, level)
    late = approach.t_s >= approach.t_s[-1] - _COMPARED_S
    return {
        "alarmed": bool(np.isfinite(alarm_s)),
        "misleading": float(lasting_share(np.where(go, largest_share(error, approach.limit_m), 0.0))[0]),
        "exceeding": float(lasting_share(np.where(quiet, shares, 0.0))[0]),
        "share": float(np.sqrt((shares[0, late] ** 2).mean())),
    }
