"""The track of a replay on a map, where the session states where its frame lies on Earth."""

from pathlib import Path

import numpy as np

from groundstation.evaluation.collector import TRACK_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figure_style import EKF
from groundstation.evaluation.run_series import ReferencePositions, RunSeries, TrackSeries, invertible
from groundstation.sinks.geographic_frame import geographic_frame
from groundstation.sinks.track_maps import MappedRun, write_maps


def write_replay_maps(folder: Path, evaluation: Evaluation) -> tuple[Path, ...]:
    """Write track.kml and track.geojson, and return them; none without an origin.

    Raises `InputError` if a file can't be written.
    """
    frame = geographic_frame(evaluation.run.place)
    if frame is None:
        return ()
    run = MappedRun(frame=frame, series=_series(evaluation), colour=EKF.removeprefix("#"))
    return write_maps(folder / "track", [run], evaluation.run.name)


def _series(evaluation: Evaluation) -> RunSeries:
    """Return the track and the references at its rows."""
    epochs = evaluation.epochs
    words = np.array([status.value for status in TRACK_STATUSES], dtype=np.str_)
    track = TrackSeries(
        t_s=epochs["t_s"],
        status=words[epochs["status"]],
        position_m=epochs["position_m"],
        covariance_m2=invertible(epochs["covariance_m2"].astype(np.float64)),
    )
    references = {
        name: ReferencePositions(
            position_m=np.where(c.usable[:, None], c.reference_m, np.nan),
            sigma_m=np.zeros(3),
        )
        for name, c in evaluation.comparisons.items()
    }
    return RunSeries(name=evaluation.run.name, track=track, references=references)
