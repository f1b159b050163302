"""Windows of pictures with true silhouettes: of recordings by other renderers, and of filmed train worlds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.session_truth import SessionTruth
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.session import load_session, load_truth
from groundstation.sources.true_silhouettes import TrueSilhouette
from groundstation.sources.video_file import VideoFile
from training.windows import LabelledWindow

_FRAME_STEP = 3
# of a picture around its target that is kept, in target widths: what windows at the largest scale and offset show
_REACH = 3.2
# targets are stored at most so wide, px: half as wide again as in most windows
_FINEST_PX = 66.0
_SIZE_SIGMA, _OFFSET_SIGMA, _MOST = 0.25, 0.13, 0.42


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedTarget:
    """A part of a picture.

    Attributes
    ----------
    image : (h, w, 3) uint8 BGR.
    cover : (h, w) uint8, 255 where the target is.
    middle_px : (2,) around which windows are placed: the silhouette's centre, or any point where none is expected.
    width_px : of the target, or as large as one would be.
    nose_px : (2,) of the target; NaN where it is not known.
    """

    image: ImageArray
    cover: ImageArray
    middle_px: FloatArray
    width_px: float
    nose_px: FloatArray


def recorded_targets(session_folder: Path) -> list[RecordedTarget]:
    """Return every third frame's target of a session's stations, with its nose where truth.csv has a row a frame."""
    session = load_session(session_folder)
    truth, pixels = SessionTruth(session), load_truth(session)
    by_frame = pixels is not None and len(pixels.t_s) == truth.pairs
    found: list[RecordedTarget] = []
    for station in session.rig.names:
        video = VideoFile(session_folder / f"{station}.mp4")
        for frame in video.frames(0, truth.pairs - 1):
            if frame.index % _FRAME_STEP:
                continue
            seen = truth.frame(station, frame.index)
            if seen is None or not seen.visible:
                continue
            nose = np.full(2, np.nan)
            if pixels is not None and by_frame and pixels.visible[station][frame.index]:
                nose = pixels.pixels_px[station][frame.index]
            silhouette = seen.silhouette
            found.append(target_in(frame.image, silhouette, silhouette.centre_px, float(silhouette.width_px), nose))
    return found


def target_in(
    image: ImageArray,
    silhouette: TrueSilhouette,
    middle_px: FloatArray,
    width_px: float,
    nose_px: FloatArray,
) -> RecordedTarget:
    """Return the part of a picture that windows around a point (2,) show."""
    half = np.array([_REACH * width_px, 0.75 * _REACH * width_px]) + 2.0
    low = np.maximum(np.floor(middle_px - half).astype(int), 0)
    high = np.minimum(np.ceil(middle_px + half).astype(int) + 1, image.shape[1::-1])
    cover = np.zeros(image.shape[:2], np.uint8)
    h, w = silhouette.mask.shape
    cover[silhouette.y : silhouette.y + h, silhouette.x : silhouette.x + w] = 255 * silhouette.mask
    part = slice(low[1], high[1]), slice(low[0], high[0])
    cut = RecordedTarget(
        image=image[part].copy(),
        cover=cover[part].copy(),
        middle_px=middle_px - low,
        width_px=width_px,
        nose_px=nose_px - low,
    )
    # a window never shows more of it
    return cut if width_px <= _FINEST_PX else _reduced(cut, _FINEST_PX / width_px)


def _reduced(target: RecordedTarget, scale: float) -> RecordedTarget:
    """Return a target in fewer pixels, each the mean of those that fall into it."""
    height, width = target.cover.shape
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    ratio = np.array(size) / (width, height)
    image, cover = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (target.image, target.cover))
    return RecordedTarget(
        image=np.asarray(image, np.uint8),
        cover=np.asarray(cover, np.uint8),
        middle_px=(target.middle_px + 0.5) * ratio - 0.5,
        width_px=float(target.width_px * ratio[0]),
        nose_px=(target.nose_px + 0.5) * ratio - 0.5,
    )


def target_window(target: RecordedTarget, size: float, place: FloatArray) -> tuple[ImageArray, FloatArray, FloatArray]:
    """Return a window (96, 128, 3), the target's share of its pixels (96, 128), and where its nose is (2,).

    The target is ``size`` px wide, with its middle at a place (2,) of the window.
    """
    scale = size / target.width_px
    if scale < 1.0:
        target, scale = _reduced(target, scale), 1.0
    middle = target.middle_px
    move = np.array([[scale, 0.0, place[0] - scale * middle[0]], [0.0, scale, place[1] - scale * middle[1]]])
    window = cv2.warpAffine(target.image, move, WINDOW_PX, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    share = cv2.warpAffine(target.cover, move, WINDOW_PX, flags=cv2.INTER_LINEAR).astype(np.float32) / 255.0
    nose = move[:, :2] @ target.nose_px + move[:, 2]
    return np.asarray(window, np.uint8), np.asarray(share, np.float32), np.asarray(nose)


def recorded_window(target: RecordedTarget, generator: np.random.Generator) -> LabelledWindow:
    """Draw a window that shows a recorded target at a drawn size and place, in drawn light, mirrored or not."""
    size = TARGET_PX * math.exp(min(max(float(generator.normal(0.0, _SIZE_SIGMA)), -0.55), 0.55))
    offset = np.clip(generator.normal(0.0, _OFFSET_SIGMA, 2), -_MOST, _MOST) * WINDOW_PX
    window, share, nose = target_window(target, size, np.array(WINDOW_PX) / 2.0 - 0.5 + offset)
    gain, lift = math.exp(float(generator.normal(0.0, 0.2))), float(generator.normal(0.0, 12.0))
    levels = gain * window.astype(np.float32) + lift
    levels += float(generator.exponential(1.5)) * generator.standard_normal(levels.shape, dtype=np.float32)
    if float(generator.uniform()) < 0.3:
        levels[:] = (levels @ np.array([0.114, 0.587, 0.299], np.float32))[:, :, None]
    step = -1 if float(generator.uniform()) < 0.5 else 1
    if step < 0:
        nose = np.array([WINDOW_PX[0] - 1.0 - nose[0], nose[1]])
    inside = bool(np.all(nose > -0.5) and nose[0] < WINDOW_PX[0] - 0.5 and nose[1] < WINDOW_PX[1] - 0.5)
    return LabelledWindow(
        image=np.ascontiguousarray(np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8)[:, ::step]),
        aircraft=np.ascontiguousarray(share[:, ::step]),
        other=np.zeros(WINDOW_PX[::-1], np.float32),
        nose_px=nose if inside else np.full(2, np.nan),
    )


def save_targets(targets: Sequence[RecordedTarget], path: Path) -> None:
    """Write targets, one after the other in three arrays: a file of many arrays is read slowly."""
    pixels = [np.dstack([t.image, t.cover]).reshape(-1, 4) for t in targets]
    np.savez(
        path,
        pixels=np.concatenate(pixels) if pixels else np.zeros((0, 4), np.uint8),
        shapes=np.array([t.cover.shape for t in targets], np.int64).reshape(-1, 2),
        numbers=np.array([[*t.middle_px, t.width_px, *t.nose_px] for t in targets], np.float64).reshape(-1, 5),
    )


def load_targets(path: Path) -> tuple[RecordedTarget, ...]:
    """Read what `save_targets` wrote."""
    with np.load(path) as file:
        pixels, shapes, numbers = file["pixels"], file["shapes"], file["numbers"]
    ends = np.cumsum(shapes.prod(axis=1))
    found = []
    for (h, w), end, (x, y, width, u, v) in zip(shapes, ends, numbers, strict=True):
        both = pixels[end - h * w : end].reshape(h, w, 4)
        found.append(
            RecordedTarget(
                image=np.ascontiguousarray(both[:, :, :3]),
                cover=np.ascontiguousarray(both[:, :, 3]),
                middle_px=np.array([x, y]),
                width_px=float(width),
                nose_px=np.array([u, v]),
            )
        )
    return tuple(found)
