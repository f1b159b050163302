"""Landings drawn from the prior of the foretold touchdown (`groundstation.landing_site.approach_prior`)."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import ScenarioError
from groundstation.landing_site.approach_prior import ApproachPrior, PathHold, WheelPosition
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.simulation.parameter_checks import require_positive
from groundstation.simulation.trajectory import SampledTrajectory

_STEP_S = 0.01
_ROLLED_S = 3.0
_SLOWEST_M_S = 1.0
_MOST_S = 300.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedLanding:
    """A drawn landing: the nose's trajectory, and when and where its wheels touch down.

    ``touchdown_s`` is session time; ``touchdown_m`` (2,) m past the threshold and right of the centre line;
    ``touchdown_sink_m_s`` the sink there.
    """

    trajectory: SampledTrajectory
    touchdown_s: float
    touchdown_m: FloatArray
    touchdown_sink_m_s: float


def draw_planned_landing(
    generator: np.random.Generator,
    site: LandingSite,
    *,
    prior: ApproachPrior,
    wheels: WheelPosition,
    start_before_aim_m: float = 400.0,
) -> PlannedLanding:
    """Draw a landing at constant steps of 10 ms, from so far before the aim point until 3 s after the touchdown.

    Raises `ScenarioError` if the site has no planned approach with a speed.
    """
    plan = site.approach
    planned_m_s = None if plan is None else plan.speed_m_s
    if plan is None or planned_m_s is None:
        raise ScenarioError("PlannedLanding: site", got="no planned speed", wanted="an approach with a speed")
    require_positive("PlannedLanding: start_before_aim_m", start_before_aim_m)
    flown = _DrawnApproach(generator, plan, planned_m_s, prior, wheels, start_before_aim_m)
    while flown.rolled_s < _ROLLED_S and flown.t_s < _MOST_S:
        flown.step(generator)
    if flown.touchdown_s is None:
        raise ScenarioError("PlannedLanding", got=f"no touchdown in {_MOST_S:g} s", wanted="a shorter approach")
    position = site.runway.runway_position(np.array(flown.rows))
    t = np.asarray(np.arange(len(position)) * _STEP_S, dtype=np.float64)
    return PlannedLanding(
        trajectory=SampledTrajectory(
            t_s=t, position_m=position, velocity_m_s=np.asarray(np.gradient(position, _STEP_S, axis=0))
        ),
        touchdown_s=flown.touchdown_s,
        touchdown_m=np.array([flown.touchdown_along_m - wheels.behind_nose_m, flown.touchdown_right_m]),
        touchdown_sink_m_s=flown.touchdown_sink_m_s,
    )


class _DrawnApproach:
    """The aircraft on its way, one step after the other; ``rows`` are of the nose: along, right, up."""

    def __init__(
        self,
        generator: np.random.Generator,
        plan: PlannedApproach,
        speed_m_s: float,
        prior: ApproachPrior,
        wheels: WheelPosition,
        start_before_aim_m: float,
    ) -> None:
        self._plan, self._speed = plan, speed_m_s
        self._slope = math.tan(plan.glide_path_rad)
        flares = prior.flares(generator.normal(size=(1, 3)), self._slope * speed_m_s)
        self._flare_m, self._sink = float(flares.height_m[0]), float(flares.touchdown_sink_m_s[0])
        self._tau_s, self._slowing = float(flares.time_constant_s[0]), float(flares.deceleration_m_s2[0])
        self._below_m = max(wheels.below_nose_m + wheels.below_nose_sigma_m * float(generator.normal()), 0.0)
        holds = [
            PathHold(sigma_m=s, hold_rad_s=prior.hold_rad_s) for s in (prior.lateral_sigma_m, prior.vertical_sigma_m)
        ]
        self._line, self._path = (np.sqrt(np.diag(h.stationary)) * generator.normal(size=2) for h in holds)
        self._steps = [h.step(_STEP_S) for h in holds]
        self._speed_step, self._sink_step = prior.speed_step(_STEP_S), prior.flare_step(_STEP_S)
        self._off_speed = prior.speed_sigma_m_s * float(generator.normal())
        self._lost = self._off_sink = 0.0
        self._flaring = False
        self.t_s = self.rolled_s = 0.0
        self._along = plan.aim_past_threshold_m - start_before_aim_m
        self._height = self._on_path()
        self.touchdown_s: float | None = None
        self.touchdown_along_m = self.touchdown_right_m = self.touchdown_sink_m_s = 0.0
        self.rows: list[list[float]] = [self._row()]

    def _on_path(self) -> float:
        return self._slope * (self._plan.aim_past_threshold_m - self._along) + float(self._path[0]) - self._below_m

    def _row(self) -> list[float]:
        return [self._along, float(self._line[0]), self._height + self._below_m]

    def step(self, generator: np.random.Generator) -> None:
        """Fly or roll for one step."""
        noise = generator.normal(size=6)
        before = (self._along, float(self._line[0]), self._height)
        speed = max(self._speed + self._off_speed - self._lost, _SLOWEST_M_S)
        self._along += _STEP_S * speed
        self._line = self._steps[0][0] @ self._line + self._steps[0][1] @ noise[0:2]
        self._path = self._steps[1][0] @ self._path + self._steps[1][1] @ noise[2:4]
        self._off_speed = self._speed_step[0] * self._off_speed + self._speed_step[1] * noise[4]
        self._off_sink = self._sink_step[0] * self._off_sink + self._sink_step[1] * noise[5]
        if self.touchdown_s is not None:
            self.rolled_s += _STEP_S
        elif self._flaring:
            self._height -= _STEP_S * (self._height / self._tau_s + self._sink - self._off_sink)
            self._lost += _STEP_S * self._slowing
        else:
            self._height = self._on_path()
            climb = -self._slope * speed + float(self._path[1])
            if self._height <= self._flare_m:
                self._flaring, self._off_sink = True, climb + self._height / self._tau_s + self._sink
        self.t_s += _STEP_S
        if self._height <= 0.0 and self.touchdown_s is None:
            self._touch_down(before)
        self.rows.append(self._row())

    def _touch_down(self, before: tuple[float, float, float]) -> None:
        share = before[2] / (before[2] - self._height)
        self.touchdown_s = self.t_s - _STEP_S * (1.0 - share)
        self.touchdown_along_m = before[0] + share * (self._along - before[0])
        self.touchdown_right_m = before[1] + share * (float(self._line[0]) - before[1])
        self.touchdown_sink_m_s = (before[2] - self._height) / _STEP_S
        self._height = 0.0
