"""Simulated flights with a wrong rig, written as session folders, and what a calibration made of them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.flight.calibrate import FlightCalibration, FlightRequest, calibrate_flight
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import PARTS, ClockModel, Rig
from groundstation.simulation import Scenario, StationErrors, case_b, perturbed, simulate
from groundstation.simulation.approach import weaving_approach
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.pointing import FirstOrderLoop
from groundstation.simulation.session_folder import write_session_folder

CLOCKS = "\n[clocks]\ndgps = {{ offset_s = 0.0 }}\ndetections = {{ offset_s = 0.0, sigma_s = {sigma} }}\n"


def approach(seed: int, errors: Mapping[str, StationErrors], *, loop: bool = False, **dgps: object) -> Scenario:
    """Case B with 2 cm DGPS; the assumed rig is the plain one, the true one differs by ``errors``."""
    pointing = FirstOrderLoop() if loop else None
    trajectory = weaving_approach() if loop else None
    ptu_hz = 50.0 if loop else None
    scenario = case_b(seed=seed, trajectory=trajectory, pointing=pointing, ptu_hz=ptu_hz)
    return replace(scenario, true_rig=perturbed(scenario.true_rig, errors), dgps=DgpsModel(**dgps))


def flown(folder: Path, scenario: Scenario, *, clocks_sigma_s: float | None = None) -> Path:
    """Write a scenario as a session; a sigma for the clocks makes session and DGPS time one."""
    session = folder / "session"
    write_session_folder(session, simulate(scenario), name="simulated")
    if clocks_sigma_s is not None:
        path = session / "session.toml"
        path.write_text(path.read_text() + CLOCKS.format(sigma=clocks_sigma_s))
    return session


def calibrated(folder: Path, scenario: Scenario, *, clocks_sigma_s: float | None = None, **how: object):
    """Write a scenario as a session and calibrate on it."""
    flown(folder, scenario, clocks_sigma_s=clocks_sigma_s)
    return run(folder, **how)


def run(folder: Path, **how: object) -> FlightCalibration:
    return calibrate_flight(FlightRequest(session=folder / "session", out=folder / "rig.toml", **how))


def unknown(rig: Rig, *parts: str) -> Rig:
    """Return the rig as one whose stations lack ``parts``."""
    left = tuple(part for part in PARTS if part not in parts)
    return replace(rig, stations=tuple(replace(s, known=left) for s in rig.stations))


def with_clock_sigma(rig: Rig, sigma_s: float) -> Rig:
    """Return the rig with PTU clocks that are not quite known."""
    return replace(
        rig,
        stations=tuple(replace(s, ptu_clock=ClockModel(sigma_s=sigma_s), ptu_clock_given=True) for s in rig.stations),
    )


def turned(found: Rig, true: Rig, name: str) -> np.ndarray:
    """Return by which small rotation (3,) rad, runway frame, the true mount differs from the one found."""
    off = matrix_from_wxyz(true[name].runway_from_base_wxyz) @ matrix_from_wxyz(found[name].runway_from_base_wxyz).T
    return 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
