"""Windows of rendered recordings with true silhouettes, of other renderers than the bank's: no nose is labelled."""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.session_truth import SessionTruth
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.session import load_session
from groundstation.sources.true_silhouettes import TrueSilhouette
from groundstation.sources.video_file import VideoFile
from training.windows import LabelledWindow

_FRAME_STEP = 3
# of a picture around its target that is kept, in target widths: what windows at the largest scale and offset show
_REACH = 3.2
_SIZE_SIGMA, _OFFSET_SIGMA, _MOST = 0.25, 0.13, 0.42


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedTarget:
    """A part of a picture (h, w, 3) and the silhouette in it, (h, w) float32, whose box has ``middle_px`` (2,)."""

    image: ImageArray
    cover: np.ndarray
    middle_px: np.ndarray
    width_px: float


def recorded_targets(session_folder: Path) -> list[RecordedTarget]:
    """Return every third frame's target of a session's stations."""
    session = load_session(session_folder)
    truth = SessionTruth(session)
    found: list[RecordedTarget] = []
    for station in session.rig.names:
        video = VideoFile(session_folder / f"{station}.mp4")
        for frame in video.frames(0, truth.pairs - 1):
            if frame.index % _FRAME_STEP:
                continue
            seen = truth.frame(station, frame.index)
            if seen is not None and seen.visible:
                found.append(_target(frame.image, seen.silhouette))
    return found


def _target(image: ImageArray, silhouette: TrueSilhouette) -> RecordedTarget:
    width = float(silhouette.width_px)
    middle = silhouette.centre_px
    half = np.array([_REACH * width, 0.75 * _REACH * width]) + 2.0
    low = np.maximum(np.floor(middle - half).astype(int), 0)
    high = np.minimum(np.ceil(middle + half).astype(int) + 1, image.shape[1::-1])
    cover = np.zeros(image.shape[:2], np.float32)
    h, w = silhouette.mask.shape
    cover[silhouette.y : silhouette.y + h, silhouette.x : silhouette.x + w] = silhouette.mask
    part = slice(low[1], high[1]), slice(low[0], high[0])
    return RecordedTarget(image=image[part].copy(), cover=cover[part].copy(), middle_px=middle - low, width_px=width)


def recorded_window(target: RecordedTarget, generator: np.random.Generator) -> LabelledWindow:
    """Draw a window that shows a recorded target at a drawn size and place, in drawn light, mirrored or not."""
    size = TARGET_PX * math.exp(min(max(float(generator.normal(0.0, _SIZE_SIGMA)), -0.55), 0.55))
    scale = size / target.width_px
    offset = np.clip(generator.normal(0.0, _OFFSET_SIGMA, 2), -_MOST, _MOST) * WINDOW_PX
    place = np.array(WINDOW_PX) / 2.0 - 0.5 + offset
    # from the window's pixels to the part's: reduced with all pixels that fall into one
    image, cover, middle = target.image, target.cover, target.middle_px
    if scale < 1.0:
        shape = max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1)
        image = np.asarray(cv2.resize(image, shape, interpolation=cv2.INTER_AREA), np.uint8)
        cover = np.asarray(cv2.resize(cover, shape, interpolation=cv2.INTER_AREA), np.float32)
        middle, scale = (middle + 0.5) * scale - 0.5, 1.0
    move = np.array([[scale, 0.0, place[0] - scale * middle[0]], [0.0, scale, place[1] - scale * middle[1]]])
    window = cv2.warpAffine(image, move, WINDOW_PX, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    share = cv2.warpAffine(cover, move, WINDOW_PX, flags=cv2.INTER_LINEAR)
    gain, lift = math.exp(float(generator.normal(0.0, 0.2))), float(generator.normal(0.0, 12.0))
    levels = gain * window.astype(np.float32) + lift
    levels += float(generator.exponential(1.5)) * generator.standard_normal(levels.shape, dtype=np.float32)
    if float(generator.uniform()) < 0.3:
        levels[:] = (levels @ np.array([0.114, 0.587, 0.299], np.float32))[:, :, None]
    step = -1 if float(generator.uniform()) < 0.5 else 1
    return LabelledWindow(
        image=np.ascontiguousarray(np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8)[:, ::step]),
        aircraft=np.ascontiguousarray(np.asarray(share, np.float32)[:, ::step]),
        other=np.zeros(WINDOW_PX[::-1], np.float32),
        nose_px=np.full(2, np.nan),
    )
