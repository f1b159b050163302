"""Runs made from a known path: stations observe it with noise, rays intersect, a plain Kalman filter follows."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.box import Box
from groundstation.evaluation.bounds import motion_matrices
from groundstation.evaluation.collector import ResultCollector
from groundstation.geometry.station import StationGeometry
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    DgpsFix,
    Innovation,
    Kinematics,
    Miss,
    MissReason,
    StepReport,
    TrackEstimate,
    TrackStatus,
    Triangulation,
    TriangulationStatus,
)
from groundstation.rig.rig import Rig

PSD = (0.3, 0.6, 0.3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Path3D:
    """A path: ``t_s`` (n,), ``position_runway_m`` (n, 3); the shape that the evaluation takes for truth."""

    t_s: np.ndarray
    position_runway_m: np.ndarray

    def at(self, t_s: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(t_s, self.t_s, self.position_runway_m[:, k]) for k in range(3)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    from_s: float
    to_s: float
    background: str


def read_path(file: Path) -> Path3D:
    """Read t_s, x_m, y_m, z_m of a table."""
    with file.open(newline="") as stream:
        rows = [[float(r[k]) for k in ("t_s", "x_m", "y_m", "z_m")] for r in csv.DictReader(stream)]
    table = np.array(rows)
    return Path3D(t_s=table[:, 0], position_runway_m=table[:, 1:])


def approach(seconds: float = 30.0, rate_hz: float = 10.0, speed_m_s: float = 15.0, start_m: float = 500.0) -> Path3D:
    """A glide towards the stations that sways sideways and flares."""
    t = np.arange(0.5, 0.5 + seconds, 1.0 / rate_hz)
    y = start_m - speed_m_s * t
    return Path3D(
        t_s=t,
        position_runway_m=np.column_stack([1.5 * np.sin(2 * np.pi * t / 8), y, 0.3 + 28.0 * (y - 40.0) / start_m]),
    )


def fixes_of(path: Path3D, offset_s: float, rng: np.random.Generator, noise_m: float = 0.015) -> list[DgpsFix]:
    """A DGPS log of a path whose clock is ``offset_s`` ahead of the session's."""
    noisy = path.position_runway_m + noise_m * rng.normal(size=path.position_runway_m.shape)
    return [DgpsFix(t_s=float(t + offset_s), position_runway_m=p) for t, p in zip(path.t_s, noisy, strict=True)]


def run_on(
    path: Path3D,
    rig: Rig,
    rng: np.random.Generator,
    *,
    pixel_sigma_px: float = 0.6,
    pan_bias_rad: float = 0.0,
    psd: tuple[float, float, float] = PSD,
) -> ResultCollector:
    """Play a path through the stations of ``rig`` into a collector."""
    collector = ResultCollector()
    for report in reports_on(path, rig, rng, pixel_sigma_px=pixel_sigma_px, pan_bias_rad=pan_bias_rad, psd=psd):
        collector.write(report)
    return collector


def reports_on(
    path: Path3D,
    rig: Rig,
    rng: np.random.Generator,
    *,
    pixel_sigma_px: float = 0.6,
    pan_bias_rad: float = 0.0,
    psd: tuple[float, float, float] = PSD,
) -> list[StepReport]:
    """Return one report per epoch; the left station's pan is read ``pan_bias_rad`` wrong."""
    geometries = [s.geometry() for s in rig.stations]
    sigmas = [s.angle_sigma_rad for s in rig.stations]
    state = np.zeros(6)
    P = np.zeros((6, 6))
    reports = []
    started = False
    for k, (t, point) in enumerate(zip(path.t_s, path.position_runway_m, strict=True)):
        cameras, views = [], []
        for n, (geometry, station) in enumerate(zip(geometries, rig.stations, strict=True)):
            offset = point - station.ptu_position_m
            pan, tilt = np.arctan2(-offset[0], offset[1]), np.arctan2(offset[2], np.hypot(*offset[:2]))
            projected = geometry.project(point, pan, tilt)
            read = np.array([pan, tilt]) + sigmas[n] * rng.normal(size=2) + [pan_bias_rad * (n == 0), 0.0]
            pixel = projected.pixel + pixel_sigma_px * rng.normal(size=2)
            views.append((geometry, read, pixel, sigmas[n]))
            cameras.append((float(t), station.name, k, pixel, read))
        ml, covariance = _triangulate(point, views, pixel_sigma_px)
        if not started:
            state[:3], P[:3, :3], P[3:, 3:] = ml, covariance, 400.0 * np.eye(3)
            started = True
        else:
            F, Q = motion_matrices(float(t - path.t_s[k - 1]), np.array(psd))
            state, P = F @ state, F @ P @ F.T + Q
            S = P[:3, :3] + covariance
            gain = P[:, :3] @ np.linalg.inv(S)
            state = state + gain @ (ml - state[:3])
            P = P - gain @ S @ gain.T
        reports.append(_report(float(t), k, cameras, ml, covariance, state.copy(), P.copy(), pixel_sigma_px, rng))
    return reports


def _triangulate(
    start: np.ndarray, views: list[tuple[StationGeometry, np.ndarray, np.ndarray, float]], sigma_px: float
) -> tuple[np.ndarray, np.ndarray]:
    point = start.copy()
    for _ in range(4):
        information, right = np.zeros((3, 3)), np.zeros(3)
        for geometry, (pan, tilt), pixel, sigma in views:
            p = geometry.project(point, pan, tilt)
            J, A = p.jacobian[:, :3], p.jacobian[:, 3:]
            weight = np.linalg.inv(sigma_px**2 * np.eye(2) + sigma**2 * A @ A.T)
            information += J.T @ weight @ J
            right += J.T @ weight @ (pixel - p.pixel)
        point = point + np.linalg.solve(information, right)
    return point, np.linalg.inv(information)


def _report(t_s, epoch, cameras, ml, covariance, state, P, sigma_px, rng) -> StepReport:
    reports = tuple(
        CameraReport(
            t_s=t,
            station=name,
            epoch=epoch,
            status=DetectionStatus.OK,
            result=Detection(
                u_px=float(pixel[0]),
                v_px=float(pixel[1]),
                covariance_px2=sigma_px**2 * np.eye(2),
                noise_px2=sigma_px**2 * np.eye(2),
                centroid_px=pixel,
                box=Box(0.0, 0.0, 10.0, 10.0),
                area_px=50.0,
                contour_px=np.zeros((0, 2), np.float32),
                contrast_to_noise=10.0,
                channel="grey",
            ),
            roi=None,
            predicted_px=None,
            predicted_covariance_px2=None,
            pan_rad=float(read[0]),
            tilt_rad=float(read[1]),
            innovation=Innovation(
                residual=np.zeros(2), covariance=np.eye(2), nis=float(rng.chisquare(2)), dof=2, accepted=True
            ),
            elapsed_s=0.008,
        )
        for t, name, epoch, pixel, read in cameras
    )
    estimate = TrackEstimate(
        t_s=t_s,
        epoch=epoch,
        status=TrackStatus.TRACKING,
        kinematics=Kinematics(position_runway_m=state[:3], velocity_runway_m_s=state[3:], covariance=P),
        triangulation_status=TriangulationStatus.OK,
        triangulation=Triangulation(
            midpoint_runway_m=ml, point_runway_m=ml, covariance_m2=covariance, gap_m=0.0, residual_sigma=0.5
        ),
        latency_s=0.02 + 0.001 * float(rng.random()),
    )
    return StepReport(cameras=reports, estimates=(estimate,))


def blind_report(t_s: float, epoch: int, station: str = "left") -> StepReport:
    """A step on which nothing was found and nothing is known."""
    look = CameraReport(
        t_s=t_s,
        station=station,
        epoch=epoch,
        status=DetectionStatus.MISS,
        result=Miss(reason=MissReason.LOW_CONTRAST),
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=None,
        tilt_rad=None,
        innovation=None,
        elapsed_s=0.03,
    )
    estimate = TrackEstimate(
        t_s=t_s,
        epoch=epoch,
        status=TrackStatus.SEARCHING,
        kinematics=None,
        triangulation_status=TriangulationStatus.ONE_VIEW,
        triangulation=None,
    )
    return StepReport(cameras=(look,), estimates=(estimate,))
