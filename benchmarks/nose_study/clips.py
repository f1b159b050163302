"""The clips of `nose-approaches`: pictures, exact poses, true edges; and the same pictures in other light."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.onboard.edges.camera_file import NoseCamera, load_nose_camera
from groundstation.onboard.edges.lines import crossings_from_lines
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, intrinsic_matrix, nose_pose, pixels_from_points
from groundstation.sources.video_file import VideoFile

Array = NDArray[np.float64]
Pictures = NDArray[np.uint8]
CLIPS = ("clear-far", "clear-10hz")
_CORNERS = ("far_left", "near_left", "far_right", "near_right")
_POSE = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseClip:
    """One clip.

    Attributes
    ----------
    name : of the clip, and of the light that was made of it.
    folder : its files.
    camera : content of its nose.toml.
    t_s : (n,) times.
    pictures : (n, h, w, 3).
    poses : (n, 6) exact position (m) and roll, pitch, yaw from the landing direction (rad).
    corners_px : (n, 4, 2) of the pavement: far left, near left, far right, near right.
    """

    name: str
    folder: Path
    camera: NoseCamera
    t_s: Array
    pictures: Pictures
    poses: Array
    corners_px: Array

    @property
    def kappa(self) -> Array:
        """Return the intrinsic matrix."""
        return intrinsic_matrix(self.camera.lens)

    def pose(self, frame: int, wrong: Array | None = None) -> NoseCameraPose:
        """Return the exact pose of a frame, or one that is wrong by (6,) m and rad."""
        own = self.poses[frame] + (0.0 if wrong is None else wrong)
        attitude = Attitude(roll_rad=float(own[3]), pitch_rad=float(own[4]), yaw_rad=float(own[5]))
        return nose_pose(own[:3], attitude, self.camera.mount)

    def true_crossings(self, frame: int, rows_px: Array) -> Array:
        """Return where the true edges cross two rows, (4,)."""
        lines = []
        for far, near in self.corners_px[frame].reshape(2, 2, 2):
            normal = np.array([near[1] - far[1], far[0] - near[0]])
            lines += [*normal, -float(normal @ far)]
        return crossings_from_lines(np.array(lines), rows_px)


def load_clip(folder: Path) -> NoseClip:
    """Read a clip's folder."""
    camera = load_nose_camera(folder / "nose.toml")
    with (folder / "truth.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    poses = np.array([[float(row[name]) for name in _POSE] for row in rows])
    poses[:, 3:] = np.radians(poses[:, 3:])
    poses[:, 5] -= camera.heading_rad
    corners = [[[float(row[f"{corner}_{axis}"]) for axis in "uv"] for corner in _CORNERS] for row in rows]
    return NoseClip(
        name=folder.name,
        folder=folder,
        camera=camera,
        t_s=np.array([float(row["t_s"]) for row in rows]),
        pictures=np.array([frame.image for frame in VideoFile(folder / "nose.mp4").frames()]),
        poses=poses,
        corners_px=np.array(corners),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherLight:
    """What is made of a clip's pictures.

    Attributes
    ----------
    gain : of the whole picture. warmth : of the red channel over the blue one.
    noise : sigma of grey levels that is added after it.
    snow : grey level that the ground is drawn to, None for the ground as it is.
    pavement : grey level that the pavement is drawn to.
    kept : share of the texture, and of the paint over the pavement, that is kept where they are drawn.
    paint : of that, share of what is brighter than the pavement by more than its texture.
    """

    gain: float = 1.0
    warmth: float = 1.0
    noise: float = 0.0
    snow: float | None = None
    pavement: float = 204.0
    kept: float = 0.2
    paint: float = 1.0


LIGHTS: dict[str, OtherLight] = {
    "clear": OtherLight(),
    "dusk": OtherLight(gain=0.35, warmth=1.3, noise=4.0),
    "dark": OtherLight(gain=0.15, warmth=1.1, noise=5.0),
    "snow": OtherLight(noise=3.0, snow=215.0),
    "rough snow": OtherLight(noise=3.0, snow=215.0, kept=1.0),
    "dim rough snow": OtherLight(gain=0.55, noise=3.0, snow=215.0, kept=1.0),
    "no paint": OtherLight(noise=3.0, snow=215.0, kept=0.6, paint=0.0),
    "nothing": OtherLight(noise=3.0, snow=204.0, kept=0.6, paint=0.0),
    "white": OtherLight(noise=4.0, snow=208.0, kept=0.1),
}


def relit(clip: NoseClip, light: str) -> NoseClip:
    """Return a clip in another light, named after it."""
    if light == "clear":
        return clip
    other, draw = LIGHTS[light], np.random.default_rng(len(light))
    pictures = np.array([_relit(clip, k, other, draw) for k in range(len(clip.pictures))])
    return replace(clip, name=f"{clip.name}, {light}", pictures=pictures)


def _relit(clip: NoseClip, frame: int, other: OtherLight, draw: np.random.Generator) -> Pictures:
    # a plane for each channel: numpy is several times as fast along a row as along three channels
    planes = np.ascontiguousarray(clip.pictures[frame].transpose(2, 0, 1), np.float64)
    if other.snow is not None:
        planes = _snowed(clip, frame, planes, other)
    planes *= other.gain * np.array([1.0 / other.warmth, 1.0, other.warmth])[:, None, None]
    planes += other.noise * draw.standard_normal(clip.pictures[frame].shape).transpose(2, 0, 1)
    np.clip(np.rint(planes, out=planes), 0, 255, out=planes)
    return np.ascontiguousarray(planes.astype(np.uint8).transpose(1, 2, 0))


def _snowed(clip: NoseClip, frame: int, planes: Array, other: OtherLight) -> Array:
    """Return a picture (3, h, w) with its ground under snow: trees, buildings and the sky stay as they are."""
    height, width = planes.shape[1:]
    far = np.array([[0.0, -20_000.0, 0.0], [8000.0, -20_000.0, 0.0]])
    (u0, v0), (u1, v1) = pixels_from_points(clip.pose(frame), clip.kappa, far)
    horizon = v0 + (np.arange(width) - u0) * (v1 - v0) / (u1 - u0)
    below = np.clip(np.arange(height)[:, None] - horizon[None, :] - 4.0, 0.0, 1.0)
    levels = planes.mean(axis=0).astype(np.float32)
    grey, usual = cv2.GaussianBlur(levels, (0, 0), 1.5), _blurred_widely(levels)
    # trees and their shadows are a quarter darker than the field about them
    below *= np.clip((grey / usual - 0.65) / 0.1, 0.0, 1.0)
    share = _coverage(clip.corners_px[frame][[0, 2, 3, 1]], width, height)
    means = [np.median(planes[:, mask], axis=1) for mask in (share > 0.9, (below > 0.5) & (share == 0.0))]
    runway, ground = (
        level + other.kept * _without_paint(planes - mean[:, None, None], other.paint)
        for level, mean in zip((other.pavement, float(other.snow or 0.0)), means, strict=True)
    )
    flat = share * runway + (1.0 - share) * ground
    # the pavement stays as it is seen, and so does what stands above the ground
    near = np.maximum(below, share)
    return np.asarray(near * flat + (1.0 - near) * planes)


def _blurred_widely(levels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return grey levels (h, w) blurred by 30 px, of a picture reduced to a fifth, in which that is 6 px."""
    height, width = levels.shape
    small = cv2.resize(levels, (width // 5, height // 5), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(cv2.GaussianBlur(small, (0, 0), 6.0), (width, height)), np.float32)


def _without_paint(texture: Array, share: float) -> Array:
    """Return a texture of which so much is left of what is brighter than the rest of it."""
    if share == 1.0:
        return texture
    most = 3.0 * float(np.median(np.abs(texture)))
    return np.where(texture > most, most * min(share + 0.3, 1.0) + share * (texture - most), texture)


def _coverage(corners_px: Array, width: int, height: int) -> Array:
    """Return how much of each pixel lies between corners (4, 2) that turn clockwise, (height, width)."""
    v, u = (axis.astype(np.float64) for axis in np.ogrid[0:height, 0:width])
    inside = np.ones((height, width))
    for (u0, v0), (u1, v1) in zip(corners_px, np.roll(corners_px, -1, axis=0), strict=True):
        off = ((u1 - u0) * (v - v0) - (v1 - v0) * (u - u0)) / np.hypot(u1 - u0, v1 - v0)
        inside = np.minimum(inside, np.clip(0.5 + off, 0.0, 1.0))
    return inside


def wrongs(frames: int, seed: int, attitude_deg: float, position_m: float) -> Iterator[Array]:
    """Yield what the pose of each frame is wrong by, (6,) m and rad: white, independent."""
    draw = np.random.default_rng(seed)
    scale = np.array([position_m] * 3 + [np.radians(attitude_deg)] * 3)
    for _ in range(frames):
        yield scale * draw.standard_normal(6)
