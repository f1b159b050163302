"""Named flights and the standard site that `groundstation simulate` films: landing, take-off, weaving approach."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_from_vector, wxyz_from_matrix
from groundstation.rig.rig import Rig, Station
from groundstation.simulation.airframes.trainer import REST_HEIGHT_PER_SPAN
from groundstation.simulation.approach import GLIDE_SLOPE_RAD, Flare, GlideApproach
from groundstation.simulation.detection_camera import CameraModel
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.jsbsim_model import fly_by_jsbsim
from groundstation.simulation.jsbsim_take_off import take_off_by_jsbsim
from groundstation.simulation.parameter_checks import require, require_not_negative, require_positive
from groundstation.simulation.path_deviation import GustModel
from groundstation.simulation.pointing import LoopLimits, SecondOrderLoop
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.scenario import Scenario
from groundstation.simulation.standard_cases import BASELINE_M, STEP_RAD, standard_station
from groundstation.simulation.take_off import TakeOff, take_off
from groundstation.simulation.trajectory import LateralWeave, SampledTrajectory, SuperposedTrajectory, Trajectory

SPAN_M = 2.3
_STEP_S = 0.02
_GUST_STREAM = 211
# gusts of the standard size are those of such a wind
_WIND_M_S = 5.0
MAX_WIND_M_S = 15.0
# below this height gusts fade out, as an aircraft on its wheels is not pushed aside
_GUST_HEIGHT_M = 12.0
_ENCODER_SIGMA_RAD = math.radians(0.01)
_DGPS_OFFSET_S = 0.3


class FlightName(StrEnum):
    """Kind of a flight."""

    LANDING = "landing"
    TAKE_OFF = "take-off"
    WEAVE = "weave"


class FlightModelKind(StrEnum):
    """Disturbance: waves of acceleration about the path, or a flight-dynamics model in turbulence."""

    WAVES = "waves"
    JSBSIM = "jsbsim"


@dataclass(frozen=True, slots=True, kw_only=True)
class TruncatedTrajectory:
    """The first part of a trajectory: its span ends at most ``duration_s`` after its start."""

    whole: Trajectory
    duration_s: float

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time, s."""
        start, end = self.whole.span_s
        return start, min(end, start + self.duration_s)

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""
        return self.whole.position(t_s)

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        return self.whole.velocity(t_s)


def flight(
    name: FlightName,
    *,
    seed: int = 0,
    wind_m_s: float = 0.0,
    duration_s: float | None = None,
    aircraft: FlightModelKind = FlightModelKind.WAVES,
) -> Trajectory:
    """Return a flight; wind gives gusts that grow with it and end near the ground, but neither drift nor crab.

    JSBSim flies its take-off itself, from the brakes on; it gives how others leave their path in turbulence.

    Raises `NoFlightModelError` where the aircraft is JSBSim's and JSBSim is not installed.
    """
    rest_m = REST_HEIGHT_PER_SPAN * SPAN_M
    flown: Trajectory
    if name is FlightName.TAKE_OFF and aircraft is FlightModelKind.JSBSIM:
        # its own from the brakes on: nothing is laid over it
        _check_wind(wind_m_s)
        flown = take_off_by_jsbsim(
            seed=seed, wind_m_s=wind_m_s, span_m=SPAN_M, start_y_m=300.0, end_y_m=60.0, rest_m=rest_m
        )
        return _shortened(flown, duration_s)
    if name is FlightName.TAKE_OFF:
        flown = take_off(TakeOff(start_y_m=300.0, start_z_m=rest_m, end_y_m=60.0))
    else:
        flare = Flare.meeting(165.0, 130.0, GLIDE_SLOPE_RAD, floor_m=rest_m)
        flown = GlideApproach(start_y_m=520.0, end_y_m=85.0, speed_m_s=20.0, aim_y_m=130.0, flare=flare)
    if name is FlightName.WEAVE:
        flown = _near_ground(flown, LateralWeave(), rest_m)
    flown = in_wind(flown, rest_m, seed=seed, wind_m_s=wind_m_s, aircraft=aircraft)
    return _shortened(flown, duration_s)


def _shortened(flown: Trajectory, duration_s: float | None) -> Trajectory:
    if duration_s is None:
        return flown
    require_positive("flight: duration_s", duration_s)
    return TruncatedTrajectory(whole=flown, duration_s=duration_s)


def _check_wind(wind_m_s: float) -> None:
    require_not_negative("flight: wind_m_s", wind_m_s)
    require(wind_m_s <= MAX_WIND_M_S, "flight: wind_m_s", got=wind_m_s, wanted=f"at most {MAX_WIND_M_S:g} m/s")


def in_wind(nominal: Trajectory, rest_m: float, *, seed: int, wind_m_s: float, aircraft: FlightModelKind) -> Trajectory:
    """Return a flight as the wind leaves it: with gusts that fade out towards the ground, where it is ``rest_m`` high.

    Raises `NoFlightModelError` where the aircraft is JSBSim's and JSBSim is not installed.
    """
    _check_wind(wind_m_s)
    if aircraft is FlightModelKind.JSBSIM:
        return _near_ground(nominal, _in_turbulence(nominal.span_s, seed, wind_m_s), rest_m)
    if wind_m_s == 0.0:
        return nominal
    generator = np.random.default_rng([seed, _GUST_STREAM])
    share = wind_m_s / _WIND_M_S
    gusts = GustModel(sigma_m_s2=(0.6 * share, 0.4 * share, 0.5 * share))
    return _near_ground(nominal, gusts.draw(generator, nominal.span_s), rest_m)


def _in_turbulence(span_s: tuple[float, float], seed: int, wind_m_s: float) -> SampledTrajectory:
    """Return how JSBSim's aircraft leaves its path in turbulence: its motion less a cubic through it."""
    samples = math.ceil((span_s[1] - span_s[0]) / _STEP_S) + 2
    moved = fly_by_jsbsim(
        seed=seed, samples=samples, rate_hz=1.0 / _STEP_S, glide_rad=GLIDE_SLOPE_RAD, wind_m_s=wind_m_s
    )
    north, east, down = moved.velocity_m_s.T
    path = np.cumsum(np.stack([-east, -north, -down], axis=1), axis=0) * _STEP_S
    t = np.asarray(span_s[0] + np.arange(samples) * _STEP_S, dtype=np.float64)
    at = np.polynomial.Polynomial.fit
    smooth = np.stack([at(t, path[:, k], 3)(t) for k in range(3)], axis=1)
    off = path - smooth
    return SampledTrajectory(t_s=t, position_m=off, velocity_m_s=np.gradient(off, t, axis=0))


def _near_ground(nominal: Trajectory, deviation: Trajectory, rest_m: float) -> SampledTrajectory:
    """Return a flight with a deviation that fades out towards the ground."""
    start, end = nominal.span_s
    t = np.linspace(start, end, max(math.ceil((end - start) / _STEP_S), 2) + 1)
    height = nominal.position(t)[:, 2] - rest_m
    share = np.clip(height / _GUST_HEIGHT_M, 0.0, 1.0)
    share = share**2 * (3.0 - 2.0 * share)
    both = SuperposedTrajectory(nominal=nominal, deviation=deviation)
    position = nominal.position(t) + share[:, None] * (both.position(t) - nominal.position(t))
    position[:, 2] = np.maximum(position[:, 2], rest_m)
    return SampledTrajectory(t_s=t, position_m=position, velocity_m_s=np.gradient(position, t, axis=0))


def site_rig() -> Rig:
    """Return the two stations of the standard site: mounts, lever arms and lenses as of real ones."""
    left = _station(
        "left", -1.0, (0.004, -0.006, 0.002), (6684.3, 6680.9), (646.8, 471.4), (-0.21, 0.6, 4e-4, -3e-4, 0)
    )
    right = _station(
        "right", 1.0, (-0.003, 0.005, -0.004), (6651.7, 6648.8), (629.5, 488.0), (-0.19, 0.4, -2e-4, 4e-4, 0)
    )
    return Rig(stations=(left, right))


def _station(
    name: str,
    side: float,
    mount_rad: tuple[float, float, float],
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    distortion: tuple[float, ...],
) -> Station:
    plain = standard_station(name, 0.5 * side * BASELINE_M, resolution_rad=STEP_RAD, sigma_rad=_ENCODER_SIGMA_RAD)
    return replace(
        plain,
        runway_from_base_wxyz=wxyz_from_matrix(rotation_from_vector(np.array(mount_rad))),
        camera_in_head_m=np.array([0.01 * side, 0.065, 0.046]),
        lens=Lens(
            image_size_px=plain.lens.image_size_px,
            focal_px=np.array(focal_px),
            principal_point_px=np.array(centre_px),
            distortion=np.array(distortion, dtype=np.float64),
        ),
    )


def rendered_scenario(trajectory: Trajectory, rig: Rig, *, seed: int = 0, frame_hz: float = 10.0) -> Scenario:
    """Return a flight with heads that follow it with lag, and DGPS with a separate clock.

    The stated rig is the true one. Angles are read 50 times a second, between the frames.
    """
    loop = SecondOrderLoop(natural_rad_s=15.0, damping=0.8, limits=LoopLimits(command_delay_s=0.05))
    ptu = PtuModel(pointing=loop, rate_hz=50.0, phase_s=0.0035, delay_s=0.004)
    return Scenario(
        trajectory=trajectory,
        true_rig=rig,
        rig=rig,
        ptus={s.name: ptu for s in rig.stations if not s.fixed},
        cameras={s.name: CameraModel() for s in rig.stations},
        dgps=DgpsModel(clock_offset_s=_DGPS_OFFSET_S),
        frame_hz=frame_hz,
        seed=seed,
    )
