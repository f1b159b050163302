"""A scenario: the trajectory, the true rig, the stated rig, and the device models."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from groundstation.rig.rig import Rig
from groundstation.simulation.detection_camera import CameraModel
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.parameter_checks import require, require_not_negative, require_positive
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.trajectory import Trajectory

MAX_PAIRS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenario:
    """One simulated flight.

    Whatever a rig file can say is in the two rigs: geometry, lens, readout, encoder steps and noise, clocks. Where
    they differ, the user is wrong. What it cannot say is in the models.

    Attributes
    ----------
    trajectory : what the target point flies; its span is what the cameras take.
    true_rig : the true stations.
    rig : the stated stations; the same names, and fixed or not.
    ptus : a model for each station that turns, by name.
    cameras : a model for each station, by name.
    dgps : None carries no receiver.
    frame_hz : stereo pairs per s; each camera adds its own phase.
    lead_s : readings (and fixes) begin so much before the first pair and end so much after the last.
    seed : of everything random.
    """

    trajectory: Trajectory
    true_rig: Rig
    rig: Rig
    ptus: Mapping[str, PtuModel]
    cameras: Mapping[str, CameraModel]
    dgps: DgpsModel | None = None
    frame_hz: float = 10.0
    lead_s: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        require_positive("Scenario: frame_hz", self.frame_hz)
        require_not_negative("Scenario: lead_s", self.lead_s)
        whole = isinstance(self.seed, int) and self.seed >= 0
        require(whole, "Scenario: seed", got=self.seed, wanted="a whole number ≥ 0")
        start, end = self.trajectory.span_s
        bounded = math.isfinite(start) and math.isfinite(end) and end > start
        require(bounded, "Scenario: trajectory", got=f"a span {start:g} to {end:g} s", wanted="an end after the start")
        pairs = (end - start) * self.frame_hz
        require(pairs < MAX_PAIRS, "Scenario: frame_hz", got=f"{pairs:.0f} pairs", wanted=f"below {MAX_PAIRS}")
        names = self.true_rig.names
        require(self.rig.names == names, "Scenario: rig", got=f"stations {self.rig.names}", wanted=f"{names}")
        fixed = tuple(s.name for s in self.true_rig.stations if s.fixed)
        stated = tuple(s.name for s in self.rig.stations if s.fixed)
        require(stated == fixed, "Scenario: rig", got=f"fixed stations {stated}", wanted=f"{fixed}")
        turning = set(names) - set(fixed)
        require(set(self.ptus) == turning, "Scenario: ptus", got=sorted(self.ptus), wanted=f"{sorted(turning)}")
        require(
            set(self.cameras) == set(names), "Scenario: cameras", got=sorted(self.cameras), wanted=f"{sorted(names)}"
        )

    def without_noise(self) -> "Scenario":
        """Return the same flight with exact pixels, angles and fixes; calibration and clock errors stay.

        The stated rig is unchanged, with its stated noise. So the two rigs differ, and an
        error of the truth is to be made from ``true_rig``.
        """
        stations = tuple(replace(s, ptu_sigma_rad=0.0, ptu_resolution_rad=0.0) for s in self.true_rig.stations)
        cameras = {
            name: replace(
                model,
                pixel_covariance_px2=np.zeros((2, 2)),
                miss_probability=0.0,
                miss_windows=(),
                outlier_probability=0.0,
            )
            for name, model in self.cameras.items()
        }
        dgps = None if self.dgps is None else replace(self.dgps, sigma_m=np.zeros(3))
        true_rig = replace(self.true_rig, stations=stations)
        ptus = {name: replace(model, delay_jitter_s=0.0) for name, model in self.ptus.items()}
        return replace(self, true_rig=true_rig, cameras=cameras, ptus=ptus, dgps=dgps)
