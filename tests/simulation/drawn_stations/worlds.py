"""A drawn flight before drawn stations, with one lens for all."""

from dataclasses import replace

import numpy as np

from groundstation.geometry.camera import Lens
from groundstation.simulation.drawn_flights import DrawnFlight, build_flight, draw_flight
from groundstation.simulation.drawn_stations import (
    BuiltStations,
    StationCamera,
    StationsSpec,
    build_stations,
    draw_stations,
)
from groundstation.simulation.event_faults import with_faults
from groundstation.simulation.simulate import SimulatedFlight, simulate

DURATION_S = 20.0
LENS = Lens(
    image_size_px=(1280, 960),
    focal_px=np.array([5200.0, 5210.0]),
    principal_point_px=np.array([641.0, 477.0]),
    distortion=np.array([-0.2, 0.5, 1e-4, -2e-4, 0.0]),
)


def stations(seed: int, count: int | None = None) -> StationsSpec:
    """Draw stations; the first ``count`` of them where it is given."""
    drawn = draw_stations(np.random.default_rng([seed, 21]), duration_s=DURATION_S)
    return drawn if count is None else replace(drawn, stations=drawn.stations[:count])


def built(spec: StationsSpec, seed: int = 0, readout_s: float = 0.0) -> BuiltStations:
    cameras = [StationCamera(lens=LENS, readout_s=readout_s, phase_s=0.004 * k) for k in range(len(spec.stations))]
    return build_stations(spec, cameras, duration_s=DURATION_S, seed=seed)


def flight(seed: int) -> DrawnFlight:
    return build_flight(draw_flight(np.random.default_rng([seed, 22]), 2.3, 0.4, DURATION_S), seed)


def simulated(seed: int, count: int | None = None, readout_s: float = 0.0) -> SimulatedFlight:
    made = built(stations(seed, count), seed, readout_s)
    return with_faults(simulate(made.scenario(flight(seed), seed=seed)), made.faults)
