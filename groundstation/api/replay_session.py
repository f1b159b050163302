"""A replay for a notebook: a session in, NumPy arrays out."""

import importlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.detection.detector_callback import DetectorCallback
from groundstation.errors import InputError
from groundstation.evaluation.collector import DETECTION_STATUSES, TRACK_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.position_series import BoolArray
from groundstation.replay.replay import ReplayRequest, replay

TextArray = NDArray[np.str_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraSeries:
    """What one camera has seen in the n frames of a replay.

    Attributes
    ----------
    t_s : (n,) mid-exposure, session time, s.
    status : (n,) words of `detections.csv`.
    pixel_px : (n, 2) the target point, u and v; not a number where none was found.
    covariance_px2 : (n, 2, 2) of that point.
    pan_rad, tilt_rad : (n,) the station's angles; not a number without a reading.
    nis : (n,) normalised innovation squared; not a number where the filter did not judge the pixel.
    accepted : (n,) whether the filter accepted the pixel.
    """

    t_s: FloatArray
    status: TextArray
    pixel_px: FloatArray
    covariance_px2: FloatArray
    pan_rad: FloatArray
    tilt_rad: FloatArray
    nis: FloatArray
    accepted: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayedSession:
    """The track of a replayed session of n stereo pairs, in the session's frame (docs/conventions.md).

    Attributes
    ----------
    name : of the session.
    t_s : (n,) session time of the pairs, s.
    status : (n,) "searching", "acquiring", "tracking", "coasting" or "lost".
    position_m, velocity_m_s : (n, 3); not a number without an estimate.
    covariance_m2 : (n, 3, 3) of the position.
    triangulated_m : (n, 3) the baseline; not a number without two views, or where the rays miss each other.
    cameras : what each station has seen, by name.
    summary : content of `summary.json`.
    fault : the fault of the recording that ended the replay early; None without one.
    """

    name: str
    t_s: FloatArray
    status: TextArray
    position_m: FloatArray
    velocity_m_s: FloatArray
    covariance_m2: FloatArray
    triangulated_m: FloatArray
    cameras: dict[str, CameraSeries]
    summary: dict[str, Any]
    fault: InputError | None

    @property
    def tracking(self) -> BoolArray:
        """Return in which pairs (n,) the target was tracked."""
        return np.asarray(self.status == "tracking")

    def to_pandas(self) -> Any:
        """Return the track as a pandas DataFrame: a row for each pair with time, status, position, velocity
        and one sigma of the position.

        Raises `InputError` where pandas is not installed.
        """
        try:
            pandas = importlib.import_module("pandas")
        except ImportError as fault:
            wanted = "it, for to_pandas: pip install pandas"
            raise InputError("pandas", got="not installed", wanted=wanted) from fault
        columns: dict[str, Any] = {"t_s": self.t_s, "status": self.status}
        for k, axis in enumerate("xyz"):
            columns[f"{axis}_m"] = self.position_m[:, k]
            columns[f"v{axis}_m_s"] = self.velocity_m_s[:, k]
            columns[f"sigma_{axis}_m"] = np.sqrt(self.covariance_m2[:, k, k])
        return pandas.DataFrame(columns)


def replay_session(
    path: str | Path,
    *,
    out: str | Path | None = None,
    rig: str | Path | None = None,
    config: str | Path | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    detector: DetectorCallback | Mapping[str, DetectorCallback] | None = None,
) -> ReplayedSession:
    """Replay a session folder, a recording (.mcap) or the folder of a live run, and return its track.

    ``rig`` and ``config`` are files that take the place of the session's own rig and of the default tuning; ``from_s``
    and ``to_s`` a part of its time, s. ``out`` is a folder for the files of `groundstation replay`; without it none
    are kept. ``detector`` is a function in place of the program's detector, as of `Tracker`. Raises `InputError` for a
    session that cannot be loaded.
    """
    with tempfile.TemporaryDirectory(prefix="groundstation-replay-") as scratch:
        request = ReplayRequest(
            session=Path(path),
            out=Path(scratch if out is None else out),
            rig=None if rig is None else Path(rig),
            config=None if config is None else Path(config),
            from_s=from_s,
            to_s=to_s,
            rerun=out is not None,
            report=out is not None,
            detector=detector,
        )
        result = replay(request)
    return _arrays(result.evaluation, result.fault)


def _arrays(evaluation: Evaluation, fault: InputError | None) -> ReplayedSession:
    """Return the tables of an evaluation as arrays."""
    epochs = evaluation.epochs
    return ReplayedSession(
        name=str(evaluation.summary["session"]["name"]),
        t_s=epochs["t_s"].copy(),
        status=_words(epochs["status"], TRACK_STATUSES),
        position_m=epochs["position_m"].copy(),
        velocity_m_s=epochs["velocity_m_s"].astype(np.float64),
        covariance_m2=epochs["covariance_m2"].astype(np.float64),
        triangulated_m=epochs["ml_point_m"].copy(),
        cameras={name: _camera(evaluation, k) for k, name in enumerate(evaluation.stations)},
        summary=evaluation.summary,
        fault=fault,
    )


def _camera(evaluation: Evaluation, station: int) -> CameraSeries:
    """Return the series of one station."""
    rows = evaluation.cameras[evaluation.cameras["station"] == station]
    return CameraSeries(
        t_s=rows["t_s"].copy(),
        status=_words(rows["status"], DETECTION_STATUSES),
        pixel_px=rows["pixel"].astype(np.float64),
        covariance_px2=rows["covariance_px2"].astype(np.float64),
        pan_rad=rows["pan_rad"].astype(np.float64),
        tilt_rad=rows["tilt_rad"].astype(np.float64),
        nis=rows["nis"].astype(np.float64),
        accepted=rows["accepted"].copy(),
    )


def _words(codes: NDArray[Any], words: tuple[Any, ...]) -> TextArray:
    """Return the words of codes."""
    return np.array([str(word) for word in words])[codes]
