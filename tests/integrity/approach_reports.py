"""Looks and reports of an approach to the standard rig, as the pipeline would give them."""

from collections.abc import Mapping

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.box import Box
from groundstation.geometry.aim import aim_at
from groundstation.integrity.fault_geometry import StationLook
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Innovation,
    Kinematics,
    StepReport,
    TrackEstimate,
    TrackStatus,
    TriangulationStatus,
)
from groundstation.rig.rig import Rig
from groundstation.simulation.approach import GlideApproach

SITE = LandingSite(runway=LandingRunway(threshold_m=(0.0, 60.0, 0.0)))
PATH = GlideApproach(start_y_m=400.0)
PIXEL_SIGMA_PX = 0.5
# of a filter near the end of an approach
SIGMAS = np.array([0.015, 0.1, 0.02, 0.05, 0.2, 0.05])


def kinematics_at(t_s: float, sigmas: FloatArray = SIGMAS) -> Kinematics:
    """Return the planned state at a time, with these sigmas."""
    t = np.array([t_s])
    return Kinematics(
        position_runway_m=PATH.position(t)[0], velocity_runway_m_s=PATH.velocity(t)[0], covariance=np.diag(sigmas**2)
    )


class Looks:
    """Looks of all stations of a rig, with noise of pixels and angles and with faults as pixels or angles off."""

    def __init__(self, rig: Rig, rng: np.random.Generator) -> None:
        self.rig, self._rng = rig, rng
        self.geometries = {s.name: s.geometry() for s in rig.stations}

    def at(
        self,
        t_s: float,
        *,
        px: Mapping[str, FloatArray] | None = None,
        rad: Mapping[str, FloatArray] | None = None,
        late_s: Mapping[str, float] | None = None,
        moved_m: FloatArray | None = None,
        noise: float = 1.0,
    ) -> tuple[StationLook, ...]:
        """Return the looks at a time; ``px`` and ``rad`` (2,) and ``late_s`` are what is wrong with a station.

        ``moved_m`` (3,) is how far the reported point is from the nose.
        """
        looks = []
        for station in self.rig.stations:
            late = (late_s or {}).get(station.name, 0.0)
            known = kinematics_at(t_s)
            point = known.position_runway_m + late * known.velocity_runway_m_s
            point = point + (np.zeros(3) if moved_m is None else moved_m)
            geometry = self.geometries[station.name]
            aimed = aim_at(geometry, known.position_runway_m)
            assert aimed is not None
            angles = np.array([aimed.pan_rad, aimed.tilt_rad])
            true = angles + (rad or {}).get(station.name, np.zeros(2))
            true = true + noise * station.angle_sigma_rad * self._rng.normal(size=2)
            seen = geometry.project(point, float(true[0]), float(true[1]))
            assert seen is not None
            off = (px or {}).get(station.name, np.zeros(2))
            looks.append(
                StationLook(
                    station=station.name,
                    t_s=t_s,
                    pixel=seen.pixel + off + noise * PIXEL_SIGMA_PX * self._rng.normal(size=2),
                    pan_rad=aimed.pan_rad,
                    tilt_rad=aimed.tilt_rad,
                    noise_px2=PIXEL_SIGMA_PX**2 * np.eye(2),
                    lasting_px2=np.zeros((2, 2)),
                )
            )
        return tuple(looks)


def report_of(
    t_s: float,
    looks: tuple[StationLook, ...],
    *,
    known: Kinematics | None = None,
    status: TrackStatus = TrackStatus.TRACKING,
) -> StepReport:
    """Return what the pipeline reports on a pair of which all pixels are accepted."""
    epoch = round(1000.0 * t_s)
    estimate = TrackEstimate(
        t_s=t_s,
        epoch=epoch,
        status=status,
        kinematics=kinematics_at(t_s) if known is None else known,
        triangulation_status=TriangulationStatus.ONE_VIEW,
        triangulation=None,
        seen_by=frozenset(look.station for look in looks),
    )
    return StepReport(cameras=tuple(camera_of(look, epoch) for look in looks), estimates=(estimate,))


def camera_of(
    look: StationLook, epoch: int, status: DetectionStatus = DetectionStatus.OK, *, accepted: bool = True
) -> CameraReport:
    """Return a camera's report of a look."""
    u, v = (float(x) for x in look.pixel)
    found = Detection(
        u_px=u,
        v_px=v,
        covariance_px2=look.noise_px2 + look.lasting_px2,
        noise_px2=look.noise_px2,
        centroid_px=look.pixel,
        box=Box(u, v, 1.0, 1.0),
        area_px=1.0,
        contour_px=np.zeros((0, 2), dtype=np.float32),
        contrast_to_noise=10.0,
        channel="labelled",
    )
    return CameraReport(
        t_s=look.t_s,
        station=look.station,
        epoch=epoch,
        status=status,
        result=found,
        roi=None,
        predicted_px=look.pixel,
        predicted_covariance_px2=look.noise_px2,
        pan_rad=look.pan_rad,
        tilt_rad=look.tilt_rad,
        innovation=Innovation(residual=np.zeros(2), covariance=look.noise_px2, nis=0.0, dof=2, accepted=accepted),
        elapsed_s=0.0,
        rates=look.rates,
    )
