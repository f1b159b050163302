"""Boards seen through a known lens: as corners with noise, and as rendered pictures."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from calibration.lens.boards import CalibrationBoard
from calibration.lens.corners import BoardView
from calibration.lens.fit import camera_matrix
from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.geometry.camera import Lens

# px of the board's own drawing for one square
_DRAWN_PX = 60
_MARGIN = 0.5


def a_lens(size: tuple[int, int] = (640, 480), focal_px: float = 700.0, k3: float = 0.0) -> Lens:
    """A lens with a moderate barrel, its centre off the image's."""
    w, h = size
    return Lens(
        image_size_px=size,
        focal_px=np.array([focal_px, 1.003 * focal_px]),
        principal_point_px=np.array([0.51 * w, 0.485 * h]),
        distortion=np.array([-0.22, 0.11, 0.0007, -0.0005, k3]),
    )


def parameters(lens: Lens) -> FloatArray:
    return np.concatenate([lens.focal_px, lens.principal_point_px, lens.distortion])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose:
    """Board to camera: Rodrigues vector and translation (3,), m."""

    rotation: FloatArray
    translation_m: FloatArray


def a_pose(
    rng: np.random.Generator, board: CalibrationBoard, lens: Lens, tilt_deg: float = 40.0, fill: float = 0.75
) -> Pose:
    """A board anywhere in the image, tilted any way, filling about ``fill`` of its height at the nearest."""
    corners = board.corners_m
    rotation = np.radians(rng.uniform(-tilt_deg, tilt_deg, 3))
    matrix = cv2.Rodrigues(rotation)[0]
    height = float(np.ptp(corners[:, 1]))
    z = lens.focal_px[1] * height / (fill * lens.image_size_px[1]) * rng.uniform(1.0, 1.8)
    reach = 0.28 * np.array(lens.image_size_px) * z / lens.focal_px
    middle = np.array([*rng.uniform(-reach, reach), z])
    return Pose(rotation=rotation, translation_m=middle - matrix @ corners.mean(axis=0))


def corner_views(
    rng: np.random.Generator,
    board: CalibrationBoard,
    lens: Lens,
    count: int,
    *,
    sigma_px: float,
    tilt_deg: float = 40.0,
) -> list[BoardView]:
    """Corners of ``count`` boards with white noise, those inside the image."""
    views: list[BoardView] = []
    while len(views) < count:
        pose = a_pose(rng, board, lens, tilt_deg)
        exact, _ = cv2.projectPoints(
            board.corners_m, pose.rotation, pose.translation_m, camera_matrix(lens), lens.distortion
        )
        pixel = exact.reshape(-1, 2) + rng.normal(0.0, sigma_px, (len(exact), 2))
        inside = np.flatnonzero(np.all((pixel > 0) & (pixel < np.array(lens.image_size_px) - 1), axis=1))
        if len(inside) > 0.6 * len(pixel):
            seen = BoardView(
                name=f"{len(views):02d}",
                ids=inside,
                board_m=board.corners_m[inside],
                pixel=pixel[inside],
                edge_px=2.0,
            )
            views.append(seen)
    return views


@lru_cache
def drawn(board: CalibrationBoard) -> ImageArray:
    """The board as it is printed, a white margin around it."""
    margin = round(_MARGIN * _DRAWN_PX)
    if board.kind == "charuco":
        inner = board.opencv().generateImage((board.columns * _DRAWN_PX, board.rows * _DRAWN_PX), marginSize=0)
    else:
        v, u = np.mgrid[0 : board.rows + 1, 0 : board.columns + 1]
        inner = np.kron(np.where((u + v) % 2, 255, 0), np.ones((_DRAWN_PX, _DRAWN_PX))).astype(np.uint8)
    return cv2.copyMakeBorder(inner, *(margin,) * 4, cv2.BORDER_CONSTANT, value=255)


@lru_cache(maxsize=2)
def rays(size: tuple[int, int], finer: int, matrix: bytes, distortion: bytes) -> Float32Array:
    """The ray (3, n) of each sub-pixel, row by row: the pictures of one lens have them in common."""
    w, h = size
    u, v = np.meshgrid((np.arange(finer * w) + 0.5) / finer - 0.5, (np.arange(finer * h) + 0.5) / finer - 0.5)
    grid = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 1e-9)
    k, d = np.frombuffer(matrix).reshape(3, 3), np.frombuffer(distortion)
    ray = cv2.undistortPoints(grid, k, d, criteria=criteria).reshape(-1, 2)
    return np.stack([*ray.T, np.ones(len(ray))]).astype(np.float32)


def render(
    rng: np.random.Generator,
    board: CalibrationBoard,
    lens: Lens,
    pose: Pose,
    *,
    blur_px: float = 0.7,
    noise: float = 2.0,
) -> ImageArray:
    """The board's picture (h, w) through a lens, a shaded grey room behind it: every sub-pixel is ray-traced."""
    w, h = lens.image_size_px
    finer = 2
    ray = rays(lens.image_size_px, finer, camera_matrix(lens).tobytes(), lens.distortion.tobytes())
    matrix = cv2.Rodrigues(pose.rotation)[0]
    origin = -matrix.T @ pose.translation_m
    # the ray o + s Rᵀr meets the board's plane where its z on the board is zero: (o_x - o_z d_x / d_z) and so in y
    board_from_ray = np.array([[origin[2], 0.0, -origin[0]], [0.0, origin[2], -origin[1]], [0.0, 0.0, -1.0]]) @ matrix.T
    # drawn px; a pixel's centre is half a pixel from its edge
    scale, shift = _DRAWN_PX / board.square_m, _MARGIN * _DRAWN_PX - 0.5
    drawn_from_board = np.array([[scale, 0.0, shift], [0.0, scale, shift], [0.0, 0.0, 1.0]])
    u, v, depth = (drawn_from_board @ board_from_ray).astype(np.float32) @ ray
    maps = ((place / depth).reshape(finer * h, finer * w) for place in (u, v))
    seen = cv2.remap(drawn(board), *maps, cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT, borderValue=90)
    seen = cv2.GaussianBlur(seen.astype(np.float32), (0, 0), finer * blur_px)
    picture = cv2.resize(seen, (w, h), interpolation=cv2.INTER_AREA)
    shade = np.linspace(0.75, 0.95, w)[None] * picture + 12.0
    return np.clip(np.round(shade + rng.normal(0.0, noise, (h, w))), 0, 255).astype(np.uint8)
