"""One landing in wind: aircraft, sensors and autopilot step by step, its trajectory so far, and how it ends."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.landing_site.runway import LandingRunway
from groundstation.simulation.flown_landing.gusty_wind import GustyWind, PlannedDescent, WindStrength
from groundstation.simulation.flown_landing.inertial_navigation import VehiclePosition
from groundstation.simulation.flown_landing.inertial_sensors import InertialSensorErrors, InertialSensors, SensedMotion
from groundstation.simulation.flown_landing.landing_autopilot import (
    LandingAutopilot,
    LandingPhase,
    LandingPlan,
    LandingState,
)
from groundstation.simulation.flown_landing.scaled_aircraft import AircraftMotion, ScaledAircraft

STEP_S = 0.005
# a landing that takes longer has failed; a go-around is watched for so long
_MOST_S, _GO_AROUND_S = 90.0, 4.0
# one sigma right of the line and above the path at the start
_START_SIGMA_M = (2.0, 1.0)
_WIND, _SENSORS, _START = 401, 402, 403


class LandingOutcome(StrEnum):
    """How an approach ended."""

    TOUCHDOWN = "touchdown"
    GO_AROUND = "go-around"
    TOUCHED_GOING_AROUND = "touched while going around"
    NO_TOUCHDOWN = "no touchdown"


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingSetup:
    """Plan, wind, sensors, runway in the runway frame; span, m, and how far before the aim the flight starts, m."""

    plan: LandingPlan = field(default_factory=LandingPlan)
    wind: WindStrength = field(default_factory=WindStrength)
    sensors: InertialSensorErrors = field(default_factory=InertialSensorErrors)
    runway: LandingRunway = field(default_factory=lambda: LandingRunway(threshold_m=(0.0, 160.0, 0.0)))
    span_m: float = 2.3
    start_before_aim_m: float = 450.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownLanding:
    """The end of an approach: ``t_s`` s after its start; of a touchdown where the wheels met the runway.

    ``touchdown_m`` (2,) past the threshold and right of the centre line; ``sink_m_s`` the sink there.
    """

    outcome: LandingOutcome
    t_s: float
    touchdown_m: FloatArray
    sink_m_s: float


class LandingFlight:
    """A landing to the north, flown until its end; as a `Trajectory` it is the nose's way so far.

    Parameters
    ----------
    seed : of wind, sensors and start: what is flown on the true state and on the stream is disturbed in the same way.

    Raises `NoFlightModelError` where JSBSim is not installed.
    """

    def __init__(self, setup: LandingSetup, seed: int) -> None:
        self.t_s = 0.0
        self.end: FlownLanding | None = None
        self.span_s = (0.0, _MOST_S)
        self._setup, plan = setup, setup.plan
        self._axes = setup.runway.axes()
        # right, down and along: the axes that the landing direction to the north gives to north, east, down
        self.runway_from_ned: FloatArray = self._axes.T @ np.diag([1.0, 1.0, -1.0])
        slope = math.tan(plan.glide_rad)
        height_m = slope * setup.start_before_aim_m
        off_m = np.random.default_rng([seed, _START]).normal(size=2) * np.array(_START_SIGMA_M)
        self._wind = GustyWind(
            np.random.default_rng([seed, _WIND]),
            setup.wind,
            PlannedDescent(height_m=height_m, sink_m_s=slope * plan.airspeed_m_s, airspeed_m_s=plan.airspeed_m_s),
            step_s=STEP_S,
            seconds=_MOST_S,
        )
        self.aircraft = ScaledAircraft(
            span_m=setup.span_m,
            step_s=STEP_S,
            height_m=height_m + off_m[1],
            speed_m_s=plan.airspeed_m_s,
            glide_rad=plan.glide_rad,
        )
        self._sensors = InertialSensors(np.random.default_rng([seed, _SENSORS]), setup.sensors, STEP_S)
        self._autopilot = LandingAutopilot(plan, STEP_S)
        start = [plan.aim_m - setup.start_before_aim_m, off_m[0], 0.0]
        self._start_runway = setup.runway.runway_position(np.array(start))
        self.sensed: SensedMotion = self._sensors.sense(self.aircraft.motion)
        self._around_s = 0.0
        self._nose: list[FloatArray] = []
        self._nose_velocity: list[FloatArray] = []
        self._keep(self.aircraft.motion)

    @property
    def phase(self) -> LandingPhase:
        """What the autopilot does."""
        return self._autopilot.phase

    def true_position(self) -> VehiclePosition:
        """Return the true state of the centre of gravity."""
        motion = self.aircraft.motion
        return VehiclePosition(
            position_runway_m=self._start_runway + self.runway_from_ned @ motion.position_ned_m,
            velocity_runway_m_s=self.runway_from_ned @ motion.velocity_ned_m_s,
            covariance=np.zeros((6, 6)),
        )

    def wheels(self, of: VehiclePosition, gap_s: float) -> LandingState:
        """Return where the wheels are if the centre of gravity is there; ``gap_s`` since a position has come."""
        place = self._setup.runway.threshold_coordinates(of.position_runway_m)
        return LandingState(
            position_m=place - np.array([0.0, 0.0, self.aircraft.wheels_below_m]),
            velocity_m_s=self._axes @ of.velocity_runway_m_s,
            gap_s=gap_s,
        )

    def step(self, known: VehiclePosition, gap_s: float) -> None:
        """Fly one step on a known position, which came ``gap_s`` ago; ``sensed`` is then of its end."""
        before = self.wheels(self.true_position(), 0.0)
        controls = self._autopilot.act(self.wheels(known, gap_s), self.sensed)
        self.aircraft.blow(self._wind.at(self.t_s, float(before.position_m[2])))
        motion = self.aircraft.step(controls)
        self.sensed = self._sensors.sense(motion)
        self.t_s = len(self._nose) * STEP_S
        self._keep(motion)
        self._judge(before, motion.on_wheels)

    def _judge(self, before: LandingState, on_wheels: bool) -> None:
        """Note the end of the approach."""
        around = self.phase is LandingPhase.GO_AROUND
        self._around_s += STEP_S * around
        outcome = None
        if on_wheels:
            outcome = LandingOutcome.TOUCHED_GOING_AROUND if around else LandingOutcome.TOUCHDOWN
        elif self._around_s >= _GO_AROUND_S:
            outcome = LandingOutcome.GO_AROUND
        elif self.t_s >= _MOST_S - STEP_S:
            outcome = LandingOutcome.NO_TOUCHDOWN
        if outcome is not None:
            self.end = FlownLanding(
                outcome=outcome,
                t_s=self.t_s,
                touchdown_m=self.wheels(self.true_position(), 0.0).position_m[:2],
                sink_m_s=-float(before.velocity_m_s[2]),
            )

    def _keep(self, motion: AircraftMotion) -> None:
        arm = self.aircraft.nose_in_body_m
        nose_ned = motion.position_ned_m + motion.ned_from_body @ arm
        turned = motion.ned_from_body @ np.cross(motion.rates_rad_s, arm)
        self._nose.append(self._start_runway + self.runway_from_ned @ nose_ned)
        self._nose_velocity.append(self.runway_from_ned @ (motion.velocity_ned_m_s + turned))

    # --------------------------------------------------------------------------------------- trajectory
    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of the nose in m at times (n,); ahead of what has been flown it goes straight on."""
        return np.array([self._nose[k] + d * self._nose_velocity[k] for k, d in map(self._place, np.asarray(t_s))])

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) of the nose in m/s at times (n,)."""
        return np.array([self._nose_velocity[k] for k, _ in map(self._place, np.asarray(t_s))])

    def _place(self, t_s: float) -> tuple[int, float]:
        """Return the nearest step, and the seconds after it."""
        k = min(max(round(t_s / STEP_S), 0), len(self._nose) - 1)
        return k, t_s - k * STEP_S


def land_on_true_state(setup: LandingSetup, seed: int) -> FlownLanding:
    """Fly a landing with position and velocity as they are, and attitude, rates and airspeed as the sensors tell."""
    flight = LandingFlight(setup, seed)
    while flight.end is None:
        flight.step(flight.true_position(), 0.0)
    return flight.end
