"""From a specification of stations to the parts of a scenario: true rig, stated rig, models of devices, faults."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.rig.rig import PARTS, ClockModel, Rig, Station
from groundstation.simulation.command_errors import CommandErrors
from groundstation.simulation.detection_camera import CameraModel, isotropic
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.drawn_stations.station_spec import (
    CalibrationSpec,
    ClockSpec,
    DgpsSpec,
    HeadSpec,
    StationSpec,
    StationsSpec,
)
from groundstation.simulation.event_faults import Fault, FaultKind
from groundstation.simulation.parameter_checks import require, require_positive
from groundstation.simulation.path_deviation import GustModel
from groundstation.simulation.pointing import LoopLimits, SecondOrderLoop
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.scenario import Scenario
from groundstation.simulation.trajectory import SampledTrajectory, Trajectory

_AIM_STREAM = 331
# optical axis along +y: the camera's z is the head's y
_IDEAL_CAMERA_WXYZ = np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0])
# the loop runs some seconds before and after the flight
_LEAD_S = 6.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationCamera:
    """Parameters of a station that its camera determines.

    ``lens`` and ``readout_s`` are the true ones; exposures are ``phase_s`` later than the pair's nominal time;
    ``pixel_sigma_px`` is that of simulated detections, where no pictures are rendered.
    """

    lens: Lens
    readout_s: float = 0.0
    phase_s: float = 0.0
    pixel_sigma_px: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BuiltStations:
    """The parts of a `Scenario`; ``ptus`` and ``cameras`` by station; ``faults`` for `with_faults` or the writer."""

    true_rig: Rig
    rig: Rig
    ptus: dict[str, PtuModel]
    cameras: dict[str, CameraModel]
    dgps: DgpsModel | None
    faults: tuple[Fault, ...]

    def scenario(self, trajectory: Trajectory, *, frame_hz: float = 10.0, seed: int = 0) -> Scenario:
        """Return the scenario of a flight before these stations."""
        return Scenario(
            trajectory=trajectory,
            true_rig=self.true_rig,
            rig=self.rig,
            ptus=self.ptus,
            cameras=self.cameras,
            dgps=self.dgps,
            frame_hz=frame_hz,
            seed=seed,
        )


def build_stations(
    spec: StationsSpec, cameras: Sequence[StationCamera], *, duration_s: float, seed: int
) -> BuiltStations:
    """Return the parts of a scenario for a flight from 0 to ``duration_s``; ``cameras`` one for each station.

    What is stated of a clock covers its drift until the flight's end. Only the wandering aim is drawn from the seed.
    """
    require_positive("build_stations: duration_s", duration_s)
    require(seed >= 0, "build_stations: seed", got=seed, wanted="a whole number ≥ 0")
    wanted = f"{len(spec.stations)}, one for each station"
    require(len(cameras) == len(spec.stations), "build_stations: cameras", got=len(cameras), wanted=wanted)
    true = [_true_station(s, c) for s, c in zip(spec.stations, cameras, strict=True)]
    stated = [_stated(s, t, duration_s) for s, t in zip(spec.stations, true, strict=True)]
    ptus = {}
    for number, (station, camera) in enumerate(zip(spec.stations, cameras, strict=True)):
        generator = np.random.default_rng([seed, _AIM_STREAM, number])
        ptus[station.name] = _ptu(station.head, camera.lens, duration_s, generator)
    gaps = () if spec.dgps is None else spec.dgps.gaps
    return BuiltStations(
        true_rig=Rig(stations=tuple(true)),
        rig=Rig(stations=tuple(stated)),
        ptus=ptus,
        cameras={
            s.name: CameraModel(phase_s=c.phase_s, pixel_covariance_px2=isotropic(c.pixel_sigma_px))
            for s, c in zip(spec.stations, cameras, strict=True)
        },
        dgps=None if spec.dgps is None else _dgps(spec.dgps),
        faults=tuple(Fault(kind=FaultKind.DGPS_GAP, from_s=gap.from_s, to_s=gap.to_s) for gap in gaps),
    )


def _true_station(spec: StationSpec, camera: StationCamera) -> Station:
    camera_turn = rotation_from_vector(np.array(spec.boresight_rad)) @ matrix_from_wxyz(_IDEAL_CAMERA_WXYZ)
    return Station(
        name=spec.name,
        fixed=False,
        known=PARTS,
        ptu_position_m=np.array(spec.position_m),
        runway_from_base_wxyz=wxyz_from_matrix(rotation_from_vector(np.array(spec.mount_rad))),
        head_from_camera_wxyz=wxyz_from_matrix(camera_turn),
        camera_in_head_m=np.array(spec.camera_in_head_m),
        lens=camera.lens,
        ptu_resolution_rad=spec.head.resolution_rad,
        ptu_sigma_rad=spec.head.encoder_sigma_rad,
        ptu_clock=_true_clock(spec.ptu_clock),
        camera_clock=_true_clock(spec.camera_clock),
        readout_s=camera.readout_s,
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
        ptu_clock_given=True,
    )


def _true_clock(clock: ClockSpec) -> ClockModel:
    return ClockModel(offset_s=clock.offset_s + clock.error_s, drift_ppm=clock.drift_ppm + clock.drift_error_ppm)


def _stated_clock(clock: ClockSpec, duration_s: float) -> ClockModel:
    drifted_s = clock.drift_sigma_ppm * 1e-6 * duration_s
    sigma_s = math.hypot(clock.sigma_s, drifted_s)
    return ClockModel(offset_s=clock.offset_s, drift_ppm=clock.drift_ppm, sigma_s=sigma_s)


def _stated(spec: StationSpec, true: Station, duration_s: float) -> Station:
    """Return what the rig file has: the true station less the errors, with the sigmas that these were drawn from."""
    calibration = spec.calibration
    stated = true.changed(-_error(calibration, true.lens))
    sigma = _covariance(calibration, stated.lens)
    uncertain = np.flatnonzero(np.diag(sigma) > 0.0)
    rolling = true.readout_s != 0.0
    return replace(
        stated,
        # the encoder sits on the motor; the head is on either side of its play, so its rms is half of it
        ptu_sigma_rad=math.hypot(true.ptu_sigma_rad, 0.5 * spec.head.backlash_rad),
        ptu_clock=_stated_clock(spec.ptu_clock, duration_s),
        camera_clock=_stated_clock(spec.camera_clock, duration_s),
        readout_s=true.readout_s - calibration.readout_error_s if rolling else 0.0,
        readout_sigma_s=calibration.readout_sigma_s if rolling else 0.0,
        covariance_parameters=tuple(CALIBRATION_PARAMETERS[k] for k in uncertain),
        covariance=sigma[np.ix_(uncertain, uncertain)],
    )


def _parts(**values: Sequence[float] | FloatArray) -> FloatArray:
    """Return the vector (21,) of `CALIBRATION_PARAMETERS` with values by group; groups not named are zero."""
    vector = np.zeros(len(CALIBRATION_PARAMETERS))
    groups = [name.partition(".")[0] for name in CALIBRATION_PARAMETERS]
    for group, numbers in values.items():
        vector[[k for k, g in enumerate(groups) if g == group]] = numbers
    return vector


def _error(calibration: CalibrationSpec, true: Lens) -> FloatArray:
    """Return the difference of the true from the stated parameters, (21,)."""
    share = calibration.focal_error_share + np.array(calibration.aspect_error_share)
    return _parts(
        runway_from_base=calibration.mount_error_rad,
        ptu_position=calibration.position_error_m,
        head_from_camera=calibration.boresight_error_rad,
        # shares are of the stated values: true = stated · (1 + share)
        focal=true.focal_px * share / (1.0 + share),
        principal_point=calibration.principal_point_error_px,
    )


def _covariance(calibration: CalibrationSpec, stated: Lens) -> FloatArray:
    """Return the covariance (21, 21) that the errors are drawn from; only the two focal lengths are correlated."""
    matrix = np.diag(
        _parts(
            runway_from_base=calibration.mount_sigma_rad,
            ptu_position=calibration.position_sigma_m,
            head_from_camera=calibration.boresight_sigma_rad,
            focal=stated.focal_px * calibration.aspect_sigma_share,
            principal_point=[calibration.principal_point_sigma_px] * 2,
        )
        ** 2
    )
    together = _parts(focal=stated.focal_px * calibration.focal_sigma_share)
    return np.asarray(matrix + np.outer(together, together))


def _ptu(head: HeadSpec, lens: Lens, duration_s: float, generator: np.random.Generator) -> PtuModel:
    # half of the picture's width and height, as angles
    half_rad = 0.5 * np.array(lens.image_size_px) / lens.focal_px
    errors = CommandErrors(
        deviation=_aim(head, float(half_rad[1]), duration_s, generator),
        stalls=tuple((stall.from_s, stall.to_s) for stall in head.stalls),
        late_until_s=head.late_s if head.late_s > 0.0 else -math.inf,
        late_by_rad=(float(half_rad[0]) * head.late_pan_share, float(half_rad[1]) * head.late_tilt_share),
    )
    limits = LoopLimits(
        max_rate_rad_s=head.max_rate_rad_s,
        max_acceleration_rad_s2=head.max_acceleration_rad_s2,
        command_delay_s=head.command_delay_s,
        backlash_rad=head.backlash_rad,
    )
    return PtuModel(
        pointing=SecondOrderLoop(natural_rad_s=head.natural_rad_s, damping=head.damping, limits=limits, errors=errors),
        rate_hz=head.rate_hz,
        phase_s=head.phase_s,
        delay_s=head.delay_s,
        delay_jitter_s=head.delay_jitter_s,
    )


def _aim(
    head: HeadSpec, half_height_rad: float, duration_s: float, generator: np.random.Generator
) -> SampledTrajectory | None:
    """Draw how the aim wanders, rad in pan and tilt: smooth, in its stationary state."""
    if head.aim_sigma_share == 0.0:
        return None
    slow_s = head.aim_correlation_s
    model = GustModel(sigma_m_s2=(1.0, 1.0, 0.0), correlation_s=0.5 * slow_s, hold_rad_s=2.0 / slow_s, damping=0.7)
    span = (-_LEAD_S, duration_s + _LEAD_S)
    drawn = model.draw(generator, span, min(0.05, 0.1 * slow_s))
    t = np.linspace(*span, math.ceil((span[1] - span[0]) / 0.02) + 1)
    size = head.aim_sigma_share * half_height_rad / model.stationary_covariance[0, 0] ** 0.5
    return SampledTrajectory(t_s=t, position_m=size * drawn.position(t), velocity_m_s=size * drawn.velocity(t))


def _dgps(spec: DgpsSpec) -> DgpsModel:
    return DgpsModel(
        rate_hz=spec.rate_hz,
        phase_s=spec.phase_s,
        sigma_m=np.array(spec.sigma_m),
        wander_sigma_m=np.array(spec.wander_sigma_m),
        wander_s=spec.wander_s,
        clock_offset_s=spec.clock_offset_s,
        antenna_in_body_m=np.array(spec.antenna_in_body_m),
    )
