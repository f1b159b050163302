"""Step reports as a pipeline would give them, made from the truth of the bundled landing; seeded noise."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.box import Box, box_of_size
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Innovation,
    Kinematics,
    Miss,
    MissReason,
    StepReport,
    TrackEstimate,
    TrackEvent,
    TrackStatus,
    Triangulation,
    TriangulationStatus,
)
from groundstation.rig.rig import load_rig

SEARCHING_PAIRS = 12
# the right camera loses the target here, and for a while no camera sees it
LOST_ON_THE_RIGHT = range(150, 166)
LOST_BY_BOTH = range(156, 164)
STATIONS = ("left", "right")
PIXEL_COVARIANCE = np.array([[0.5, 0.1], [0.1, 0.3]])


def _table(path: Path) -> dict[str, FloatArray]:
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {key: np.array([float(row[key] or "nan") for row in rows]) for key in rows[0]}


@dataclass
class Landing:
    """The bundled landing's truth, and the reports of an imagined run over it, repeated ``laps`` times."""

    folder: Path
    laps: int = 1
    seed: int = 7
    track_t_s: list[float] = field(default_factory=list)
    track_m: list[FloatArray] = field(default_factory=list)
    sigma_m: list[FloatArray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.rig = load_rig(self.folder / "rig.toml")
        self.stations = {s.name: s.geometry() for s in self.rig.stations}
        self.frames, self.ptu = _table(self.folder / "frames.csv"), _table(self.folder / "ptu.csv")
        self.truth, self.dgps = _table(self.folder / "truth.csv"), _table(self.folder / "dgps.csv")
        self.truth_m = np.column_stack([self.truth[k] for k in ("x_m", "y_m", "z_m")])
        self.dgps_m = np.column_stack([self.dgps[k] for k in ("x_m", "y_m", "z_m")])
        with np.load(self.folder / "masks.npz") as masks:
            self.contours = {name: self._contour(masks, name) for name in masks.files if not name.endswith("_xy")}

    @staticmethod
    def _contour(masks: "np.lib.npyio.NpzFile", name: str) -> np.ndarray:
        mask = np.pad(masks[name].astype(np.uint8), 1)
        corner = masks[f"{name}_xy"]
        pieces, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        rows: list[np.ndarray] = []
        for piece in pieces:
            gap = [np.full((1, 2), np.nan)] if rows else []
            rows += [*gap, piece[:, 0, :] - 1.0 + corner]
        return np.concatenate(rows).astype(np.float32) if rows else np.zeros((0, 2), np.float32)

    def reports(self) -> Iterator[StepReport]:
        """One report for each stereo pair."""
        count = len(self.frames["index"])
        span_s = float(self.frames["left_t_s"][-1] - self.frames["left_t_s"][0]) + 0.1
        for lap in range(self.laps):
            for n in range(count):
                yield self._step(n, lap * count + n, lap * span_s)

    def _step(self, n: int, epoch: int, shift_s: float) -> StepReport:
        cameras = tuple(self._camera(name, n, epoch, shift_s) for name in STATIONS)
        events = []
        if n == 0:
            events.append(TrackEvent(t_s=cameras[0].t_s, level="info", text="searching the whole frame"))
        if n == LOST_BY_BOTH.start:
            events.append(TrackEvent(t_s=cameras[0].t_s, level="warning", text="no camera sees the target: coasting"))
        return StepReport(cameras=cameras, estimates=(self._estimate(n, epoch, shift_s),), events=tuple(events))

    def _camera(self, name: str, n: int, epoch: int, shift_s: float) -> CameraReport:
        t_s = float(self.frames[f"{name}_t_s"][n])
        pan, tilt = (
            float(np.radians(np.interp(t_s, self.ptu["t_s"], self.ptu[f"{name}_{k}_deg"]))) for k in ("pan", "tilt")
        )
        projection = self.stations[name].project(self.truth_m[n], pan, tilt)
        assert projection is not None
        lost = n in LOST_BY_BOTH or (name == "right" and n in LOST_ON_THE_RIGHT)
        searching = n < SEARCHING_PAIRS
        status = DetectionStatus.MISS if lost or searching else DetectionStatus.OK
        reason = MissReason.LOW_CONTRAST if lost else MissReason.NO_REGION
        result: Detection | Miss = Miss(reason=reason, detail="contrast to noise 1.4, wanted 3")
        contour = self.contours.get(f"{name}_{n:04d}", np.zeros((0, 2), np.float32))
        low, high = np.nanmin(contour, axis=0), np.nanmax(contour, axis=0)
        innovation = None
        if status is DetectionStatus.OK:
            noise = self.rng.multivariate_normal([0.0, 0.0], PIXEL_COVARIANCE)
            u, v = projection.pixel + noise
            result = Detection(
                u_px=float(u),
                v_px=float(v),
                covariance_px2=PIXEL_COVARIANCE,
                noise_px2=0.1 * PIXEL_COVARIANCE,
                centroid_px=(low + high).astype(np.float64) / 2,
                box=Box(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
                area_px=float(np.prod(high - low) / 3),
                contour_px=contour,
                contrast_to_noise=12.0,
                channel="value",
            )
            nis = float(self.rng.chisquare(2)) + (15.0 if n % 97 == 0 else 0.0)
            innovation = Innovation(residual=noise, covariance=PIXEL_COVARIANCE, nis=nis, dof=2, accepted=nis < 13.8)
        predicted = None if searching else projection.pixel + self.rng.normal(0.0, 1.5, 2)
        width, height = int(high[0] - low[0]) + 250, int(high[1] - low[1]) + 100
        corner = np.clip(projection.pixel - [width / 2, height / 2], 0, None).astype(int)
        return CameraReport(
            t_s=t_s + shift_s,
            station=name,
            epoch=epoch,
            status=status,
            result=result,
            roi=None if searching else box_of_size(int(corner[0]), int(corner[1]), width, height),
            predicted_px=predicted,
            predicted_covariance_px2=None if predicted is None else np.array([[9.0, 2.0], [2.0, 4.0]]),
            pan_rad=pan,
            tilt_rad=tilt,
            innovation=innovation,
            elapsed_s=float(self.rng.uniform(0.006, 0.011)),
        )

    def _estimate(self, n: int, epoch: int, shift_s: float) -> TrackEstimate:
        t_s = float(self.truth["t_s"][n]) + shift_s
        y = self.truth_m[n][1]
        coasting = n in LOST_BY_BOTH
        sigma = np.array([0.03 + y / 8000, 0.05 + (y / 200) ** 2 * 0.35, 0.03 + y / 9000]) * (3.0 if coasting else 1.0)
        if n < SEARCHING_PAIRS:
            return TrackEstimate(
                t_s=t_s,
                epoch=epoch,
                status=TrackStatus.SEARCHING,
                kinematics=None,
                triangulation_status=TriangulationStatus.ONE_VIEW,
                triangulation=None,
                latency_s=0.03,
            )
        position = self.truth_m[n] + self.rng.normal(0.0, sigma)
        self.track_t_s.append(t_s)
        self.track_m.append(position)
        self.sigma_m.append(sigma)
        point = self.truth_m[n] + self.rng.normal(0.0, 3.0 * sigma)
        seen = n not in LOST_ON_THE_RIGHT
        return TrackEstimate(
            t_s=t_s,
            epoch=epoch,
            status=TrackStatus.COASTING if coasting else TrackStatus.TRACKING,
            kinematics=Kinematics(
                position_runway_m=position,
                velocity_runway_m_s=np.array([0.0, -14.0, -1.0]),
                covariance=np.diag([*sigma**2, 0.1, 0.2, 0.1]),
            ),
            triangulation_status=TriangulationStatus.OK if seen else TriangulationStatus.ONE_VIEW,
            triangulation=Triangulation(
                midpoint_runway_m=point,
                point_runway_m=point,
                covariance_m2=np.diag((3 * sigma) ** 2),
                gap_m=0.02,
                residual_sigma=1.0,
            )
            if seen
            else None,
            latency_s=float(self.rng.uniform(0.014, 0.024)),
        )

    def errors_m(self) -> FloatArray:
        """The error (n, 3) of the positions given so far against the truth."""
        t = np.array(self.track_t_s)
        truth = np.column_stack([np.interp(t, self.truth["t_s"], self.truth_m[:, k]) for k in range(3)])
        return np.array(self.track_m) - truth
