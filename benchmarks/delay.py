"""Effect of a delay: the error some time after the newest pixel, extrapolated with the filter's own models.

Flights drawn from the filter's motion model (case B at 10 Hz), y 60–400 m. Requested for 0 … 200 ms after the newest
pair; compared with an extrapolation by a constant 110 ms whatever the true delay, as in the paper, and with none.
Figures in docs/notes/position.md.
"""

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np

from groundstation.messages import InitialState
from groundstation.simulation import SimulatedFlight, case_b, simulate
from groundstation.simulation.standard_cases import BOUND_PSD_M2_S3
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

DELAYS_S = (0.0, 0.05, 0.11, 0.15, 0.2)
PAPER_S = 0.11


def start_of(flight: SimulatedFlight) -> InitialState:
    truth = flight.truth
    return InitialState(
        t_s=0.0,
        position_runway_m=truth.position_runway_m[0],
        velocity_runway_m_s=truth.velocity_runway_m_s[0],
        sigma_position_m=np.full(3, 10.0),
        sigma_velocity_m_s=np.full(3, 5.0),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=20)
    options = parser.parse_args()
    config = Config()
    tuning = replace(
        config.estimation,
        acceleration_psd_m2_s3=BOUND_PSD_M2_S3,
        manoeuvre_psd_m2_s3=BOUND_PSD_M2_S3,
        labelled_sigma_px=0.5,
        fix_window_s=0.005,
    )
    errors: dict[tuple[str, float], list[np.ndarray]] = defaultdict(list)
    stated: dict[float, list[np.ndarray]] = defaultdict(list)
    for seed in range(options.flights):
        flight = simulate(case_b(seed=seed, white_encoder=True))
        path = flight.scenario.trajectory
        pipeline = Pipeline(flight.rig, replace(config, estimation=tuning), initial=start_of(flight))
        for event in flight.events:
            for e in pipeline.step(event).estimates:
                if e.kinematics is None or e.t_s < 8.0 or e.t_s + DELAYS_S[-1] > path.span_s[1]:
                    continue
                for delay in DELAYS_S:
                    truth = path.position(np.array([e.t_s + delay]))[0]
                    at = pipeline.estimate_at(e.t_s + delay)
                    if at is None:
                        continue
                    newest = e.kinematics
                    errors["asked", delay].append(at.position_runway_m - truth)
                    stated[delay].append(np.diag(at.covariance)[:3])
                    constant = newest.position_runway_m + PAPER_S * newest.velocity_runway_m_s
                    errors["constant", delay].append(constant - truth)
                    errors["none", delay].append(newest.position_runway_m - truth)
    print("RMSE in m, x/y/z       asked for             stated σ              constant 110 ms       as it is")
    for delay in DELAYS_S:
        cells = [np.sqrt((np.array(errors["asked", delay]) ** 2).mean(axis=0)), np.sqrt(np.mean(stated[delay], axis=0))]
        cells += [np.sqrt((np.array(errors[kind, delay]) ** 2).mean(axis=0)) for kind in ("constant", "none")]
        print(f"{1e3 * delay:4.0f} ms              " + "  ".join("/".join(f"{v:.4f}" for v in c) for c in cells))


if __name__ == "__main__":
    main()
