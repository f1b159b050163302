"""Frames of a session with the prediction of a simulated filter and the exact truth.

In place of a filter, the truth with a seeded error is the prediction: the true pixel with 4 px (one sigma) of noise in
u and v, the true span with 10 %. The rest of the hint is built by the pipeline's own code from the true position
and velocity.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.detection.detector import DetectionHint
from groundstation.errors import SessionError
from groundstation.evaluation.metrics import phase_masks
from groundstation.messages import Frame, PtuSample
from groundstation.session import Session, Truth, load_truth
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.true_silhouettes import SilhouetteArchive, TrueSilhouette
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel
from groundstation.tracking.config import Config

PREDICTION_SIGMA_PX = 4.0
SPAN_SIGMA_RATIO = 0.1
_UNKNOWN_PHASE = "unstated"


@dataclass(frozen=True, kw_only=True, eq=False)
class TruthScene:
    """One frame: the picture, the hint, and the truth: nose (2,) px, silhouette, background behind it."""

    frame: Frame
    hint: DetectionHint
    nose_px: FloatArray
    silhouette: TrueSilhouette
    background: str


def scenes(
    session: Session, seed: int, *, first_epoch: int = 0, last_epoch: int | None = None, every: int = 1
) -> Iterator[TruthScene]:
    """Yield the frames of a session in order of time, of each ``every``-th pair, those with the nose in view.

    Raises `SessionError` for a session without truth.csv, masks.npz or wing span.
    """
    truth = load_truth(session)
    if truth is None or session.target.span_m is None:
        raise SessionError(session.name, got="no truth or no wing span", wanted="a rendered session with both")
    silhouettes = SilhouetteArchive(session)
    velocity = np.gradient(truth.position_runway_m, truth.t_s, axis=0)
    trackers = {station.name: CameraTracker(station, Config()) for station in session.rig.stations}
    generators = {name: np.random.default_rng([seed, k]) for k, name in enumerate(sorted(trackers))}
    angles: dict[str, PtuSample] = {}
    with FolderSource(session) as source:
        for event in source:
            if isinstance(event, PtuSample):
                angles[event.station] = event
            if not isinstance(event, Frame) or event.epoch < first_epoch or event.station not in angles:
                continue
            if last_epoch is not None and event.epoch > last_epoch:
                return
            if (event.epoch - first_epoch) % every:
                continue
            # drawn for every frame, so that one frame's draw does not hang on another's being in view
            draw = generators[event.station].normal(size=3)
            row = int(np.argmin(np.abs(truth.t_s - event.t_s)))
            silhouette = silhouettes.find(event.station, event.epoch)
            if not truth.visible[event.station][row] or silhouette is None:
                continue
            hint = _hint(trackers[event.station], angles[event.station], (truth, velocity, row), session, draw)
            if hint is None:
                continue
            yield TruthScene(
                frame=event,
                hint=hint,
                nose_px=truth.pixels_px[event.station][row],
                silhouette=silhouette,
                background=background_at(session, event.t_s),
            )


def background_at(session: Session, t_s: float) -> str:
    """Return the background behind the aircraft at this time, from the session."""
    masks = phase_masks(np.array([t_s]), session.phases)
    return next((name for name, inside in masks.items() if inside[0]), _UNKNOWN_PHASE)


def _hint(
    tracker: CameraTracker,
    angles: PtuSample,
    state: tuple[Truth, FloatArray, int],
    session: Session,
    draw: FloatArray,
) -> DetectionHint | None:
    """Return the filter's prediction, the truth being off by ``draw`` (3,) standard normal numbers."""
    truth, velocity, row = state
    position = truth.position_runway_m[row]
    projection = tracker.geometry.project(position, angles.pan_rad, angles.tilt_rad)
    if projection is None or session.target.span_m is None:
        return None
    predicted = truth.pixels_px[tracker.station.name][row] + PREDICTION_SIGMA_PX * draw[:2]
    return tracker.hint(
        predicted,
        PREDICTION_SIGMA_PX**2 * np.eye(2),
        projection.jacobian[:, :3],
        projection.depth_m,
        float(truth.t_s[row]),
        (velocity[row], np.zeros((3, 3))),
        SpanModel(session.target.span_m * float(np.exp(SPAN_SIGMA_RATIO * draw[2]))),
        float(position[2]),
    )
