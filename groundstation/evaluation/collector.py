"""A sink that keeps what the evaluation needs of each step, and nothing else.

One stereo epoch takes about 150 bytes and one camera's look 60: a session of one hour at 10 Hz stays below
10 MB. Inside the two tables an absent value is NaN; the properties below return masks with the values.
"""

from array import array
from collections import Counter, defaultdict, deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.evaluation.growable_table import GrowableTable
from groundstation.evaluation.unconfirmed_rows import UnconfirmedRows
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    InitialPixel,
    Miss,
    MissReason,
    StepReport,
    TrackEstimate,
    TrackStatus,
    TriangulationStatus,
)

TRACK_STATUSES = tuple(TrackStatus)
TRIANGULATION_STATUSES = tuple(TriangulationStatus)
DETECTION_STATUSES = tuple(DetectionStatus)
MISS_REASONS = tuple(MissReason)
NO_REASON = len(MISS_REASONS)
MAX_EVENTS = 1000

EPOCH_DTYPE = np.dtype(
    [
        ("epoch", "i4"),
        ("t_s", "f8"),
        ("status", "u1"),
        ("position_m", "f8", 3),
        ("velocity_m_s", "f4", 3),
        ("covariance_m2", "f4", (3, 3)),
        ("triangulation_status", "u1"),
        ("ml_point_m", "f8", 3),
        ("ml_covariance_m2", "f4", (3, 3)),
        ("midpoint_m", "f4", 3),
        ("latency_s", "f4"),
    ]
)
CAMERA_DTYPE = np.dtype(
    [
        ("epoch", "i4"),
        ("t_s", "f8"),
        ("station", "u1"),
        ("status", "u1"),
        ("reason", "u1"),
        ("pixel", "f4", 2),
        ("covariance_px2", "f4", (2, 2)),
        ("pan_rad", "f4"),
        ("tilt_rad", "f4"),
        ("nis", "f4"),
        ("dof", "u1"),
        ("accepted", "?"),
        ("elapsed_s", "f4"),
    ]
)
_NO_POINT = np.full(3, np.nan)
_NO_MATRIX = np.full((3, 3), np.nan)
_NO_PIXEL = np.full(2, np.nan)
_NO_PIXEL_MATRIX = np.full((2, 2), np.nan)
# cells of a frame of a search
_SEARCHED: dict[str, Any] = {
    "status": DETECTION_STATUSES.index(DetectionStatus.MISS),
    "reason": MISS_REASONS.index(MissReason.NOT_ACQUIRED),
    "pixel": _NO_PIXEL,
    "covariance_px2": _NO_PIXEL_MATRIX,
    "nis": np.nan,
    "dof": 0,
    "accepted": False,
}


class ResultCollector:
    """Collect epochs and camera looks in compact tables for `evaluate_run`."""

    def __init__(self) -> None:
        self._epochs = GrowableTable(EPOCH_DTYPE)
        self._cameras = GrowableTable(CAMERA_DTYPE)
        self._stations: dict[str, int] = {}
        self.events: list[tuple[float, str, str]] = []
        self.events_dropped = 0
        self._unconfirmed = UnconfirmedRows[int]()
        self._contrast: defaultdict[str, defaultdict[str, array[float]]] = defaultdict(
            lambda: defaultdict(lambda: array("f"))
        )
        self._channels: defaultdict[str, Counter[str]] = defaultdict(Counter)

    @property
    def stations(self) -> tuple[str, ...]:
        """Station names in the order of their first report; the tables hold the index."""
        return tuple(self._stations)

    @property
    def tracked_share(self) -> float:
        """Share of the epochs in which a target was tracked; 0 without epochs."""
        tracked = self._epochs.rows()["status"] == TRACK_STATUSES.index(TrackStatus.TRACKING)
        return float(np.mean(tracked)) if len(tracked) else 0.0

    @property
    def nbytes(self) -> int:
        """Memory held by the tables, in bytes."""
        return self._epochs.nbytes + self._cameras.nbytes

    def write(self, report: StepReport) -> None:
        """Keep one step."""
        first = len(self._cameras)
        for camera in report.cameras:
            self._add_camera(camera)
        for row, pixel in self._unconfirmed.take(report, range(first, len(self._cameras))):
            self._cameras.change(row, **(_SEARCHED if pixel is None else _initial_cells(pixel)))
        deque(self._unconfirmed.final(), maxlen=0)
        for estimate in report.estimates:
            self._add_estimate(estimate)
        for event in report.events:
            if len(self.events) < MAX_EVENTS:
                self.events.append((event.t_s, event.level, event.text))
            else:
                self.events_dropped += 1

    def close(self) -> None:
        """Do nothing; the tables stay readable."""

    def channels(self) -> dict[str, dict[str, Any]]:
        """Return by station how often each channel was used, and the median contrast-to-noise on every channel."""
        return {
            name: {
                "used": dict(self._channels.get(name, {})),
                "contrast_to_noise": {
                    channel: float(np.median(values)) for channel, values in self._contrast.get(name, {}).items()
                },
            }
            for name in self._stations
        }

    def epochs(self) -> NDArray[Any]:
        """Return the epochs, (n,) of `EPOCH_DTYPE`, in time order; equal times keep their first row."""
        rows = self._epochs.rows()
        if np.all(np.diff(rows["t_s"]) > 0):
            return rows
        _, first = np.unique(rows["t_s"], return_index=True)
        return rows[first]

    def cameras(self) -> NDArray[Any]:
        """Return the camera looks, (m,) of `CAMERA_DTYPE`, in the order in which they came."""
        return self._cameras.rows()

    def _add_estimate(self, e: TrackEstimate) -> None:
        k, tri = e.kinematics, e.triangulation
        self._epochs.append(
            e.epoch,
            e.t_s,
            TRACK_STATUSES.index(e.status),
            _NO_POINT if k is None else k.position_runway_m,
            _NO_POINT if k is None else k.velocity_runway_m_s,
            _NO_MATRIX if k is None else k.covariance[:3, :3],
            TRIANGULATION_STATUSES.index(e.triangulation_status),
            _NO_POINT if tri is None else tri.point_runway_m,
            _NO_MATRIX if tri is None else tri.covariance_m2,
            _NO_POINT if tri is None else tri.midpoint_runway_m,
            e.latency_s,
        )

    def _add_camera(self, c: CameraReport) -> None:
        found = c.result if isinstance(c.result, Detection) else None
        reason = MISS_REASONS.index(c.result.reason) if isinstance(c.result, Miss) else NO_REASON
        judged = c.innovation
        if found is not None:
            self._channels[c.station][found.channel] += 1
        for channel, contrast in (c.channel_contrast or {}).items():
            self._contrast[c.station][channel].append(contrast)
        self._cameras.append(
            c.epoch,
            c.t_s,
            self._stations.setdefault(c.station, len(self._stations)),
            DETECTION_STATUSES.index(c.status),
            reason,
            _NO_PIXEL if found is None else (found.u_px, found.v_px),
            _NO_PIXEL_MATRIX if found is None else found.covariance_px2,
            np.nan if c.pan_rad is None else c.pan_rad,
            np.nan if c.tilt_rad is None else c.tilt_rad,
            np.nan if judged is None else judged.nis,
            0 if judged is None else judged.dof,
            judged is not None and judged.accepted,
            c.elapsed_s,
        )


def _initial_cells(p: InitialPixel) -> dict[str, Any]:
    """Return the cells of a frame that was searched without a target, by which it was found later."""
    return {
        "status": DETECTION_STATUSES.index(DetectionStatus.INITIAL),
        "reason": NO_REASON,
        "pixel": (p.u_px, p.v_px),
        "covariance_px2": np.eye(2) * p.sigma_px**2,
    }
