"""The standard cases B and C, for which the bounds of docs/derivation.md are known.

Both: stations 10.77 m apart at a height of 1.5 m, f = 6667 px, 1280 × 960 px. They differ in noise, and in
what the number 0.00625° is: in B the encoder's *step*, with a noise of rms of 0.00625°/√12 = 0.0018°; in C
itself the *rms* of a reading's noise, without steps.
"""

import numpy as np

from groundstation.geometry.camera import Lens
from groundstation.rig.rig import PARTS, ClockModel, Rig, Station
from groundstation.simulation.approach import bound_glide, weaving_approach
from groundstation.simulation.detection_camera import CameraModel, isotropic
from groundstation.simulation.path_deviation import drawn_deviation
from groundstation.simulation.pointing import IdealPointing, PointingModel
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.scenario import Scenario
from groundstation.simulation.trajectory import SuperposedTrajectory, Trajectory

BASELINE_M = 10.77
FOCAL_PX = 6667.0
PTU_HEIGHT_M = 1.5
STEP_RAD = float(np.radians(0.00625))
BOUND_PSD_M2_S3 = (0.05, 0.1, 0.05)
# keeps the draw of the flight apart from the draws of its measurements
_TRACK_STREAM = 77
_THIRD_STATION_M = (40.0, 100.0)


def standard_station(
    name: str, x_m: float, y_m: float = 0.0, *, resolution_rad: float = STEP_RAD, sigma_rad: float = 0.0
) -> Station:
    """Return a perfectly levelled station with the standard lens; resolution and noise of its angles in rad."""
    return Station(
        name=name,
        fixed=False,
        known=PARTS,
        ptu_position_m=np.array([x_m, y_m, PTU_HEIGHT_M]),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
        camera_in_head_m=np.zeros(3),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([FOCAL_PX, FOCAL_PX]),
            principal_point_px=np.array([639.5, 479.5]),
            distortion=np.zeros(5),
        ),
        ptu_resolution_rad=resolution_rad,
        ptu_sigma_rad=sigma_rad,
        ptu_clock=ClockModel(),
        camera_clock=None,
        readout_s=0.0,
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
    )


def standard_rig(*, resolution_rad: float = STEP_RAD, sigma_rad: float = 0.0, third: bool = False) -> Rig:
    """Return the stations "left" and "right", and "third" at (40, 100) m if requested."""
    places = {"left": (-BASELINE_M / 2, 0.0), "right": (BASELINE_M / 2, 0.0)}
    if third:
        places["third"] = _THIRD_STATION_M
    return Rig(
        stations=tuple(
            standard_station(name, *place, resolution_rad=resolution_rad, sigma_rad=sigma_rad)
            for name, place in places.items()
        )
    )


def drawn_glide(
    seed: int, acceleration_psd_m2_s3: tuple[float, float, float] = BOUND_PSD_M2_S3, nominal: Trajectory | None = None
) -> Trajectory:
    """Return a flight drawn from the filter's own motion model around a nominal one (the bounds' glide).

    Nothing holds it to its path: near the end it may well be metres away, or under the runway.
    """
    base = bound_glide() if nominal is None else nominal
    generator = np.random.default_rng([seed, _TRACK_STREAM])
    psd = acceleration_psd_m2_s3
    deviation = drawn_deviation(generator, span_s=base.span_s, acceleration_psd_m2_s3=psd)
    return SuperposedTrajectory(nominal=base, deviation=deviation)


def case_b(
    *,
    seed: int = 0,
    rate_hz: float = 10.0,
    trajectory: Trajectory | None = None,
    pointing: PointingModel | None = None,
    ptu_hz: float | None = None,
    white_encoder: bool = False,
) -> Scenario:
    """Return case B: pixels of 0.5 px, encoders with steps of 0.00625° and no other noise.

    Parameters
    ----------
    rate_hz : stereo pairs per s.
    trajectory : None draws one from the bounds' motion model, by the seed.
    pointing : None aims exactly.
    ptu_hz : rate of the readings; None takes one at each exposure, as the bounds assume.
    white_encoder : white noise of the same rms in place of the steps, as the bounds assume. The errors of a slowly
        turning encoder are not white: at 400 m the head takes longer than a frame for one step.
    """
    flight = drawn_glide(seed) if trajectory is None else trajectory
    rig = standard_rig(resolution_rad=0.0, sigma_rad=STEP_RAD / 12**0.5) if white_encoder else standard_rig()
    return _case(rig, flight, 0.5, seed=seed, rate_hz=rate_hz, pointing=pointing, ptu_hz=ptu_hz)


def case_c(
    *,
    seed: int = 0,
    rate_hz: float = 10.0,
    trajectory: Trajectory | None = None,
    pointing: PointingModel | None = None,
    ptu_hz: float | None = None,
) -> Scenario:
    """Return case C: pixels of 1 px, angles with white noise of 0.00625° rms and no steps.

    ``trajectory`` None is the predictors' weaving approach from y = 450 m; the other parameters are those of
    `case_b`. The posterior bounds of case C are for `drawn_glide`.
    """
    flight = weaving_approach() if trajectory is None else trajectory
    rig = standard_rig(resolution_rad=0.0, sigma_rad=STEP_RAD)
    return _case(rig, flight, 1.0, seed=seed, rate_hz=rate_hz, pointing=pointing, ptu_hz=ptu_hz)


def _case(
    rig: Rig,
    trajectory: Trajectory,
    pixel_sigma_px: float,
    *,
    seed: int,
    rate_hz: float,
    pointing: PointingModel | None,
    ptu_hz: float | None,
) -> Scenario:
    ptu = PtuModel(
        pointing=IdealPointing() if pointing is None else pointing,
        rate_hz=rate_hz if ptu_hz is None else ptu_hz,
        phase_s=trajectory.span_s[0],
    )
    camera = CameraModel(pixel_covariance_px2=isotropic(pixel_sigma_px))
    return Scenario(
        trajectory=trajectory,
        true_rig=rig,
        rig=rig,
        ptus=dict.fromkeys(rig.names, ptu),
        cameras=dict.fromkeys(rig.names, camera),
        frame_hz=rate_hz,
        seed=seed,
    )
