"""Simulated flights at the level of angles and pixels, without pictures: time-ordered events and exact truth.

A `Scenario` holds the trajectory, the true rig and the stated rig;
`simulate` turns it into a `SimulatedFlight`. Everything random comes from the scenario's seed.
"""

from groundstation.simulation.rig_errors import StationErrors, perturbed
from groundstation.simulation.scenario import Scenario
from groundstation.simulation.simulate import FlightTruth, SimulatedFlight, simulate
from groundstation.simulation.standard_cases import case_b, case_c, standard_rig

__all__ = [
    "FlightTruth",
    "Scenario",
    "SimulatedFlight",
    "StationErrors",
    "case_b",
    "case_c",
    "perturbed",
    "simulate",
    "standard_rig",
]
