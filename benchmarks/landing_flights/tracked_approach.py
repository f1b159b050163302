"""One approach to the standard site, tracked by the shipped tuning from the pixels of two stations.

The cameras are those of case B: pixels of 0.5 px, encoders with steps of 0.00625°, ten pairs a second, at y = 0. The
rig is stated with 0.01° of pan and tilt at each station, one sigma, and the true one is drawn from that.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.landing_site.approach_prior import ApproachPrior, WheelPosition
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Event, InitialState, Kinematics, StepReport, TrackStatus
from groundstation.rig.rig import Rig
from groundstation.simulation import case_b, simulate
from groundstation.simulation.airframes.trainer import REST_HEIGHT_PER_SPAN
from groundstation.simulation.approach import GLIDE_SLOPE_RAD, Flare, GlideApproach
from groundstation.simulation.flights import SPAN_M, FlightModelKind, TruncatedTrajectory, in_wind
from groundstation.simulation.planned_landing import draw_planned_landing
from groundstation.simulation.rig_errors import StationErrors, drawn_errors, perturbed
from groundstation.simulation.trajectory import Trajectory
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

PAIRS_HZ = 10.0
SPEED_M_S = 20.0
START_BEFORE_AIM_M = 330.0
MOUNT_SIGMA_RAD = math.radians(0.01)
WHEELS = WheelPosition(below_nose_m=REST_HEIGHT_PER_SPAN * SPAN_M)
SITE = LandingSite(
    runway=LandingRunway(threshold_m=(0.0, 160.0, 0.0)),
    approach=PlannedApproach(glide_path_rad=GLIDE_SLOPE_RAD, aim_past_threshold_m=30.0, speed_m_s=SPEED_M_S),
)
_AIM_Y_M = 130.0
_START_SIGMA = (3.0, 2.0)
_PAST_TOUCHDOWN_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Landing:
    """A trajectory of the nose with the touchdown of its wheels: session time, and (2,) past the threshold, right."""

    trajectory: Trajectory
    touchdown_s: float
    touchdown_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackedApproach:
    """A landing with the pipeline's reports on it."""

    landing: Landing
    reports: tuple[StepReport, ...]

    def estimates(self) -> list[tuple[float, Kinematics]]:
        """Return times and estimates of the pairs with a track."""
        known = (TrackStatus.TRACKING, TrackStatus.COASTING)
        found = [e for r in self.reports for e in r.estimates if e.status in known]
        return [(e.t_s, e.kinematics) for e in found if e.kinematics is not None]


def prior_landing(seed: int) -> Landing:
    """Draw a landing from the stated prior."""
    generator = np.random.default_rng([seed, 301])
    drawn = draw_planned_landing(
        generator, SITE, prior=ApproachPrior(), wheels=WHEELS, start_before_aim_m=START_BEFORE_AIM_M
    )
    return Landing(trajectory=drawn.trajectory, touchdown_s=drawn.touchdown_s, touchdown_m=drawn.touchdown_m)


def gusty_landing(seed: int, wind_m_s: float, aircraft: FlightModelKind) -> Landing:
    """Return a landing of the simulation: one flare for all, and gusts; nothing of it is the prior's."""
    flare = Flare.meeting(165.0, _AIM_Y_M, GLIDE_SLOPE_RAD, floor_m=WHEELS.below_nose_m)
    glide = GlideApproach(
        start_y_m=_AIM_Y_M + START_BEFORE_AIM_M, end_y_m=60.0, speed_m_s=SPEED_M_S, aim_y_m=_AIM_Y_M, flare=flare
    )
    flown = in_wind(glide, WHEELS.below_nose_m, seed=seed, wind_m_s=wind_m_s, aircraft=aircraft)
    t = np.arange(flown.span_s[0], flown.span_s[1], 0.005)
    there = flown.position(t)
    down = int(np.argmax(there[:, 2] <= WHEELS.below_nose_m + 1e-4))
    if down == 0:
        raise ValueError(f"flight {seed} does not touch down")
    coordinates = SITE.runway.threshold_coordinates(there[down])
    return Landing(trajectory=flown, touchdown_s=float(t[down]), touchdown_m=coordinates[:2])


def track(landing: Landing, seed: int) -> TrackedApproach:
    """Track a landing until shortly after its touchdown, from a start off by metres."""
    pipeline, events = watched(landing, seed, PAIRS_HZ)
    return TrackedApproach(landing=landing, reports=(*(pipeline.step(event) for event in events), pipeline.finish()))


def watched(
    landing: Landing, seed: int, pairs_hz: float, mount_sigma_rad: float = MOUNT_SIGMA_RAD
) -> tuple[Pipeline, Sequence[Event]]:
    """Return a pipeline before its first event, and what the stations see and read until shortly after a touchdown."""
    until_s = landing.touchdown_s + _PAST_TOUCHDOWN_S - landing.trajectory.span_s[0]
    flown = TruncatedTrajectory(whole=landing.trajectory, duration_s=until_s)
    plain = case_b(seed=seed, rate_hz=pairs_hz, trajectory=flown)
    stated = _with_covariance(plain.rig, mount_sigma_rad) if mount_sigma_rad else plain.rig
    sigma = StationErrors(mount_rad=np.array([mount_sigma_rad, 0.0, mount_sigma_rad]))
    errors = drawn_errors(np.random.default_rng([seed, 302]), stated.names, sigma)
    flight = simulate(replace(plain, rig=stated, true_rig=perturbed(stated, errors)))
    start_s = flown.span_s[0]
    at = np.array([start_s])
    off = np.random.default_rng([seed, 303]).normal(size=(2, 3)) * np.array(_START_SIGMA)[:, None]
    initial = InitialState(
        t_s=start_s,
        position_runway_m=flown.position(at)[0] + off[0],
        velocity_runway_m_s=flown.velocity(at)[0] + off[1],
        sigma_position_m=np.full(3, _START_SIGMA[0]),
        sigma_velocity_m_s=np.full(3, _START_SIGMA[1]),
    )
    shipped = Config()
    tuning = replace(shipped.estimation, labelled_sigma_px=0.5)
    return Pipeline(flight.rig, replace(shipped, estimation=tuning), initial=initial), flight.events


def _with_covariance(rig: Rig, mount_sigma_rad: float) -> Rig:
    """Return the rig with the stated uncertainty of each station's pan and tilt."""
    names = ("runway_from_base.x", "runway_from_base.z")
    covariance = mount_sigma_rad**2 * np.eye(2)
    return Rig(stations=tuple(replace(s, covariance_parameters=names, covariance=covariance) for s in rig.stations))
