"""Three stations with PTUs and wrong mounts: effect of their estimation from the misclosure of rays."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from filter_flights.calibration import drawn_parameters, usual_prior, with_errors
from filter_flights.consistency import WIDE, Sample, drawn_case, one_mode
from filter_flights.run_filter import drawn_start, drive
from groundstation.estimation.config import CalibrationUse
from groundstation.simulation import Scenario, simulate
from groundstation.simulation.standard_cases import STEP_RAD, standard_rig

STATIONS = ("left", "right", "third")
PAN_AND_TILT = tuple(f"{s}.runway_from_base.{axis}" for s in STATIONS for axis in "zx")
WHOLE_MOUNTS = tuple(f"{s}.runway_from_base.{axis}" for s in STATIONS for axis in "xyz")
# readings begin before the first pair
_LEAD_S = 0.2


def three_stations(seed: int) -> Scenario:
    """Return case B at 10 Hz with a third station at (40, 100) m."""
    plain = drawn_case("B", seed, 10.0)
    rig = standard_rig(third=True, resolution_rad=0.0, sigma_rad=STEP_RAD / 12**0.5)
    ptus = dict.fromkeys(rig.names, plain.ptus["left"])
    cameras = dict.fromkeys(rig.names, plain.cameras["left"])
    return replace(plain, true_rig=rig, rig=rig, ptus=ptus, cameras=cameras)


def flown(names: Sequence[str], seeds: Sequence[int], use: CalibrationUse, times_prior: float = 1.0) -> Sample:
    """Fly with errors of ``names`` drawn from their prior, 0.05° each, or from so many times it; no reference."""
    prior = usual_prior(names)
    config = replace(one_mode(), calibration=use)
    runs = []
    for seed in seeds:
        truth = times_prior * drawn_parameters(prior, seed)
        flight = simulate(with_errors(three_stations(seed), names, truth))
        runs.append(drive(flight, config, drawn_start(flight, seed, *WIDE, lead_s=_LEAD_S), prior=prior))
    return Sample(runs=runs, bound_m2=np.zeros((0, 0, 3)))
