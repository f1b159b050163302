"""Windows of pictures with true silhouettes: of recordings by other renderers, and of filmed train worlds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.bank.session_truth import SessionTruth
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.session import load_session, load_truth
from groundstation.sources.frame_table import read_frames
from groundstation.sources.true_silhouettes import TrueSilhouette
from groundstation.sources.video_file import VideoFile
from training.windows import LabelledWindow, in_window

_PAIR_STEP = 3
# of a picture around its target that is kept, in target widths: what windows at the largest scale and offset show
_REACH = 3.2
# targets are stored at most so wide, px: half as wide again as in most windows
_FINEST_PX = 66.0
_SIZE_SIGMA, _OFFSET_SIGMA, _MOST = 0.25, 0.13, 0.42
_MIST_SHARE, _BLURRED_SHARE, _NOISY_SHARE = 0.2, 0.15, 0.15
# of a file: the picture's colours, aircraft, birds
_PLANES = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedTarget:
    """A part of a picture.

    Attributes
    ----------
    image : (h, w, 3) uint8 BGR.
    cover : (h, w) uint8, 255 where the target, or another aircraft, is.
    other : (h, w) uint8, 255 where birds are.
    middle_px : (2,) around which windows are placed: the silhouette's centre, or any point where none is expected.
    width_px : of the target, or as large as one would be.
    nose_px : (2,) of the target; NaN where it is not known.
    kinds : of airframe, scenery and sky; none where they are not known.
    around_target : whether ``middle_px`` is on the target, and not somewhere else in the picture.
    """

    image: ImageArray
    cover: ImageArray
    other: ImageArray
    middle_px: FloatArray
    width_px: float
    nose_px: FloatArray
    kinds: tuple[str, ...] = ()
    around_target: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledPicture:
    """A picture (h, w, 3) uint8 BGR, and where aircraft and birds are in it, (h, w) uint8 up to 255 each."""

    image: ImageArray
    cover: ImageArray
    other: ImageArray


def recorded_targets(session_folder: Path) -> list[RecordedTarget]:
    """Return every third pair's target in each station's video, with its nose where truth.csv has a row a pair."""
    session = load_session(session_folder)
    truth, exact, table = SessionTruth(session), load_truth(session), read_frames(session)
    by_pair = exact is not None and len(exact.t_s) == truth.pairs
    found: list[RecordedTarget] = []
    for station in session.rig.names:
        # frames.csv says which pair a frame of the video belongs to: it may begin later, or leave frames out
        numbers = table.numbers[station]
        pairs = {int(number): pair for pair, number in enumerate(numbers) if truth.taken(station, pair)}
        noses = exact.pixels_px.get(station) if exact is not None and by_pair else None
        video = VideoFile(session_folder / f"{station}.mp4")
        for frame in video.frames(min(pairs, default=0), max(pairs, default=-1)):
            pair = pairs.get(frame.index, -1)
            seen = truth.frame(station, pair) if pair >= 0 and pair % _PAIR_STEP == 0 else None
            if seen is None or not seen.visible:
                continue
            nose = np.full(2, np.nan)
            if exact is not None and noses is not None and exact.visible[station][pair]:
                nose = noses[pair]
            silhouette = seen.silhouette
            picture = labelled_picture(frame.image, silhouette)
            found.append(target_in(picture, silhouette.centre_px, float(silhouette.width_px), nose))
    return found


def labelled_picture(image: ImageArray, silhouette: TrueSilhouette) -> LabelledPicture:
    """Return a picture with one aircraft and no birds."""
    cover = np.zeros(image.shape[:2], np.uint8)
    h, w = silhouette.mask.shape
    cover[silhouette.y : silhouette.y + h, silhouette.x : silhouette.x + w] = 255 * silhouette.mask
    return LabelledPicture(image=image, cover=cover, other=np.zeros_like(cover))


def target_in(
    picture: LabelledPicture,
    middle_px: FloatArray,
    width_px: float,
    nose_px: FloatArray,
    kinds: tuple[str, ...] = (),
    *,
    around_target: bool = True,
) -> RecordedTarget:
    """Return the part of a picture that windows around a point (2,) show."""
    half = np.array([_REACH * width_px, 0.75 * _REACH * width_px]) + 2.0
    low = np.maximum(np.floor(middle_px - half).astype(int), 0)
    high = np.minimum(np.ceil(middle_px + half).astype(int) + 1, picture.image.shape[1::-1])
    part = slice(low[1], high[1]), slice(low[0], high[0])
    cut = RecordedTarget(
        image=picture.image[part].copy(),
        cover=picture.cover[part].copy(),
        other=picture.other[part].copy(),
        middle_px=middle_px - low,
        width_px=width_px,
        nose_px=nose_px - low,
        kinds=kinds,
        around_target=around_target,
    )
    # a window never shows more of it
    return cut if width_px <= _FINEST_PX else _reduced(cut, _FINEST_PX / width_px)


def _reduced(target: RecordedTarget, scale: float) -> RecordedTarget:
    """Return a target in fewer pixels, each the mean of those that fall into it."""
    height, width = target.cover.shape
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    ratio = np.array(size) / (width, height)
    planes = (target.image, target.cover, target.other)
    image, cover, other = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in planes)
    return replace(
        target,
        image=np.asarray(image, np.uint8),
        cover=np.asarray(cover, np.uint8),
        other=np.asarray(other, np.uint8),
        middle_px=(target.middle_px + 0.5) * ratio - 0.5,
        width_px=float(target.width_px * ratio[0]),
        nose_px=(target.nose_px + 0.5) * ratio - 0.5,
    )


def target_window(target: RecordedTarget, size: float, place: FloatArray) -> LabelledWindow:
    """Return a window in which the target is ``size`` px wide, with its middle at a place (2,) of the window.

    The nose is where it is, inside the window or not.
    """
    scale = size / target.width_px
    if scale < 1.0:
        target, scale = _reduced(target, scale), 1.0
    middle = target.middle_px
    move = np.array([[scale, 0.0, place[0] - scale * middle[0]], [0.0, scale, place[1] - scale * middle[1]]])
    window = cv2.warpAffine(target.image, move, WINDOW_PX, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    aircraft, other = (
        cv2.warpAffine(each, move, WINDOW_PX, flags=cv2.INTER_LINEAR).astype(np.float32) / np.float32(255.0)
        for each in (target.cover, target.other)
    )
    return LabelledWindow(
        image=np.asarray(window, np.uint8),
        aircraft=np.asarray(aircraft, np.float32),
        other=np.asarray(other, np.float32),
        nose_px=move[:, :2] @ target.nose_px + move[:, 2],
        kinds=target.kinds,
    )


def recorded_window(target: RecordedTarget, generator: np.random.Generator) -> LabelledWindow:
    """Draw a window that shows a recorded target at a drawn size and place, in drawn light, mirrored or not."""
    size = TARGET_PX * math.exp(min(max(float(generator.normal(0.0, _SIZE_SIGMA)), -0.55), 0.55))
    offset = np.clip(generator.normal(0.0, _OFFSET_SIGMA, 2), -_MOST, _MOST) * WINDOW_PX
    shown = target_window(target, size, np.array(WINDOW_PX) / 2.0 - 0.5 + offset)
    levels = _seen_worse(shown.image.astype(np.float32), generator)
    if float(generator.uniform()) < 0.3:
        levels[:] = (levels @ np.array([0.114, 0.587, 0.299], np.float32))[:, :, None]
    step, nose = -1 if float(generator.uniform()) < 0.5 else 1, shown.nose_px
    if step < 0:
        nose = np.array([WINDOW_PX[0] - 1.0 - nose[0], nose[1]])
    return LabelledWindow(
        image=np.ascontiguousarray(np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8)[:, ::step]),
        aircraft=np.ascontiguousarray(shown.aircraft[:, ::step]),
        other=np.ascontiguousarray(shown.other[:, ::step]),
        nose_px=nose if in_window(nose) else np.full(2, np.nan),
        kinds=target.kinds,
    )


def _seen_worse(levels: Float32Array, generator: np.random.Generator) -> Float32Array:
    """Return a window's levels with other exposure and noise, now and then in mist or out of focus."""
    if float(generator.uniform()) < _MIST_SHARE:
        left = float(generator.uniform(0.3, 1.0))
        levels = left * levels + (1.0 - left) * float(generator.uniform(90.0, 230.0))
    if float(generator.uniform()) < _BLURRED_SHARE:
        levels = np.asarray(cv2.GaussianBlur(levels, (0, 0), float(generator.uniform(0.5, 2.5))), np.float32)
    gain, lift = math.exp(float(generator.normal(0.0, 0.2))), float(generator.normal(0.0, 12.0))
    levels = gain * levels + lift
    noisy = float(generator.uniform()) < _NOISY_SHARE
    sigma = float(generator.uniform(3.0, 12.0)) if noisy else float(generator.exponential(1.5))
    levels += sigma * generator.standard_normal(levels.shape, dtype=np.float32)
    return levels


def save_targets(targets: Sequence[RecordedTarget], path: Path) -> None:
    """Write targets, one after the other in few arrays: a file of many arrays is read slowly."""
    pixels = [np.dstack([t.image, t.cover, t.other]).reshape(-1, _PLANES) for t in targets]
    np.savez(
        path,
        pixels=np.concatenate(pixels) if pixels else np.zeros((0, _PLANES), np.uint8),
        shapes=np.array([t.cover.shape for t in targets], np.int64).reshape(-1, 2),
        numbers=np.array(
            [[*t.middle_px, t.width_px, *t.nose_px, t.around_target] for t in targets], np.float64
        ).reshape(-1, 6),
        kinds=np.array([" ".join(t.kinds) for t in targets], np.str_),
    )


def load_targets(path: Path) -> tuple[RecordedTarget, ...]:
    """Read what `save_targets` wrote."""
    with np.load(path) as file:
        pixels, shapes, numbers, kinds = (file[name] for name in ("pixels", "shapes", "numbers", "kinds"))
    ends = np.cumsum(shapes.prod(axis=1))
    found = []
    for (h, w), end, (x, y, width, u, v, around), words in zip(shapes, ends, numbers, kinds, strict=True):
        planes = pixels[end - h * w : end].reshape(h, w, _PLANES)
        found.append(
            RecordedTarget(
                image=np.ascontiguousarray(planes[:, :, :3]),
                cover=np.ascontiguousarray(planes[:, :, 3]),
                other=np.ascontiguousarray(planes[:, :, 4]),
                middle_px=np.array([x, y]),
                width_px=float(width),
                nose_px=np.array([u, v]),
                kinds=tuple(str(words).split()),
                around_target=bool(around),
            )
        )
    return tuple(found)
