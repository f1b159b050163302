"""Frames of a session with the prediction of a simulated filter and the exact truth.

Instead of a filter, the truth with a seeded error predicts: the true pixel with 4 px (one sigma) of noise in u and in
v, the true span with 10 %. Everything else of the hint is built by the pipeline's own code from the true position
and velocity.
"""

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, MaskArray
from groundstation.detection.detector import DetectionHint
from groundstation.errors import SessionError
from groundstation.evaluation.metrics import phase_masks
from groundstation.files.image_header import MAX_PICTURE_PX
from groundstation.files.toml_table import shown
from groundstation.messages import Frame, PtuSample
from groundstation.session import Session, Truth, load_truth
from groundstation.sources.folder_source import FolderSource, read_frames
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel
from groundstation.tracking.config import Config

PREDICTION_SIGMA_PX = 4.0
SPAN_SIGMA_RATIO = 0.1
_UNKNOWN_PHASE = "unstated"
# what numpy and zipfile raise for an archive that is damaged, or none
_DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, AttributeError, RuntimeError, MemoryError, SyntaxError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
_MAX_CORNER_PX = 100_000
# of an array in masks.npz, whose values are bytes
_HEADER_BYTES = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueSilhouette:
    """The true silhouette: ``mask`` (h, w) with its upper-left pixel at column ``x`` and row ``y`` of the image."""

    x: int
    y: int
    mask: MaskArray

    @property
    def width_px(self) -> int:
        """Width of the silhouette in px."""
        columns = np.flatnonzero(self.mask.any(axis=0))
        return int(columns[-1] - columns[0] + 1)

    @property
    def centre_px(self) -> FloatArray:
        """Centre of its pixels, (2,)."""
        rows, columns = np.nonzero(self.mask)
        return np.array([self.x + columns.mean(), self.y + rows.mean()])


@dataclass(frozen=True, kw_only=True, eq=False)
class TruthScene:
    """One frame: the picture, the hint, and the truth: nose (2,) px, silhouette, what lies behind it."""

    frame: Frame
    hint: DetectionHint
    nose_px: FloatArray
    silhouette: TrueSilhouette
    background: str


class SilhouetteArchive:
    """The session's masks.npz by station and epoch."""

    def __init__(self, session: Session) -> None:
        path = session.folder / "masks.npz"
        if not path.is_file():
            raise SessionError(session.name, got="no masks.npz", wanted="a rendered session with true silhouettes")
        self._where = f"{session.name}: masks.npz"
        try:
            self._archive = zipfile.ZipFile(BytesIO(path.read_bytes()))
            self._names = frozenset(name.removesuffix(".npy") for name in self._archive.namelist())
        except _DAMAGE as fault:
            raise self._fault(str(fault)) from fault
        self._numbers = read_frames(session).index

    def find(self, station: str, epoch: int) -> TrueSilhouette | None:
        """Return the silhouette, None where the aircraft is not in the picture."""
        key = f"{station}_{int(self._numbers[epoch]):04d}"
        if key not in self._names:
            return None
        mask, corner = self._array(key, 2), self._array(f"{key}_xy", 1)
        if not mask.any():
            return None
        if len(corner) != 2 or max(abs(int(v)) for v in corner) > _MAX_CORNER_PX:
            raise self._fault(f"{key}_xy is no corner of a silhouette")
        return TrueSilhouette(x=int(corner[0]), y=int(corner[1]), mask=mask > 0)

    def _array(self, key: str, dimensions: int) -> NDArray[Any]:
        """Return an array of whole numbers; raises `SessionError` where the archive is damaged there."""
        try:
            found = _member(self._archive, f"{key}.npy")
        except _DAMAGE as fault:
            raise self._fault(f"{key}: {fault}") from fault
        if found.ndim != dimensions or found.dtype.kind not in "biu":
            raise self._fault(f"{key}: {found.ndim} dimensions of {found.dtype}")
        return found

    def _fault(self, got: str) -> SessionError:
        return SessionError(self._where, got=shown(got), wanted="silhouettes, as `groundstation simulate` writes them")


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
    """Return what the filter would expect, the truth being off by ``draw`` (3,) standard normal numbers."""
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


def _member(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """Return one array of an archive, as numpy writes it; raises one of `_DAMAGE`.

    numpy makes room for the shape that a member claims, and unpacks all that is packed: both are looked at before.
    """
    most = MAX_PICTURE_PX + _HEADER_BYTES
    with archive.open(name) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise ValueError(f"more than {most} bytes")
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    shape, _, dtype = read_header[version](stream, max_header_size=_HEADER_BYTES)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"an array {shape} of {dtype} in {len(data) - stream.tell()} bytes")
    stream.seek(0)
    found: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return found
