"""The compiled arithmetic of the edges once more in plain numpy, as it is written on paper: what tests compare with."""

import numpy as np

from groundstation.onboard.edges.pose import NoseCameraPose, pixels_from_points


def pixel_from_ground(pose: NoseCameraPose, kappa: np.ndarray) -> np.ndarray:
    rotation = pose.threshold_from_camera.T
    return kappa @ np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ pose.camera_threshold_m])


def line_map(pose: NoseCameraPose, kappa: np.ndarray) -> np.ndarray:
    return np.linalg.inv(pixel_from_ground(pose, kappa)).T


def project_lines(state: np.ndarray, e: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    crossings, jacobian = np.empty(4), np.zeros((4, 4))
    for line, own in enumerate(([0, 1, 2], [0, 1, 3])):
        l0, l1, l2 = e @ state[own]
        for end, v in enumerate(rows):
            k = 2 * line + end
            crossings[k] = -(l1 * v + l2) / l0
            jacobian[k, own] = np.array([-crossings[k] / l0, -v / l0, -1.0 / l0]) @ e
    return crossings, jacobian


def pose_jacobian(crossings: np.ndarray, rows: np.ndarray, pose: NoseCameraPose, kappa: np.ndarray) -> np.ndarray:
    slopes = np.repeat((crossings[1::2] - crossings[0::2]) / (rows[1] - rows[0]), 2)
    ray = np.column_stack([crossings, np.tile(rows, 2), np.ones(4)]) @ np.linalg.inv(kappa).T
    x, y, one, zero = ray[:, 0], ray[:, 1], np.ones(4), np.zeros(4)
    near = (-(ray @ pose.threshold_from_camera[2]) / pose.camera_threshold_m[2])[:, None]
    by_x = np.hstack([np.stack([x * y, -(1.0 + x * x), y], axis=1), np.stack([-one, zero, x], axis=1) * near])
    by_y = np.hstack([np.stack([1.0 + y * y, -x * y, -x], axis=1), np.stack([zero, -one, y], axis=1) * near])
    return kappa[0, 0] * by_x + kappa[0, 1] * by_y - slopes[:, None] * kappa[1, 1] * by_y


def ground_from_pixels(pose: NoseCameraPose, kappa: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(kappa).T @ pose.threshold_from_camera.T
    reach = -pose.camera_threshold_m[2] / rays[:, 2]
    ground = pose.camera_threshold_m[:2] + reach[:, None] * rays[:, :2]
    ground[~(reach > 0.0)] = np.nan
    return ground


def state_from_ground(ground: np.ndarray) -> np.ndarray:
    along = ground[:, 1] - ground[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    mean = along.sum(axis=0) / np.linalg.norm(along.sum(axis=0))
    normal = np.array([mean[1], -mean[0]])
    normal = normal if normal[0] >= 0.0 else -normal
    return np.array([*normal, *(-(0.3 * ground[:, 0] + 0.7 * ground[:, 1]) @ normal)])


def seen_rows(
    pose: NoseCameraPose,
    kappa: np.ndarray,
    size: tuple[int, int],
    sides: tuple[float, float],
    ends: tuple[float, float],
) -> np.ndarray | None:
    y = pose.camera_threshold_m[1]
    ys, seen = y - np.geomspace(y - ends[0], y - ends[1], 40), []
    for x in sides:
        pixels = pixels_from_points(pose, kappa, np.column_stack([np.full(40, x), ys, np.zeros(40)]))
        with np.errstate(invalid="ignore"):
            good = ((pixels >= 2.0) & (pixels <= np.array(size) - 3.0)).all(axis=1)
        if not good.any():
            return None
        seen.append(pixels[good, 1])
    return np.array([max(s.min() for s in seen), min(s.max() for s in seen)])


def update(
    mean: np.ndarray, p: np.ndarray, h: np.ndarray, innovation: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Joseph's form with the norm-constrained gain; the mean, the covariance and the NIS."""
    s = h @ p @ h.T + noise
    gain, weighted = np.linalg.solve(s, h @ p).T, np.linalg.solve(s, innovation)
    free = (mean + gain @ innovation)[:2]
    gain[:2] += (1.0 / np.hypot(*free) - 1.0) / (innovation @ weighted) * np.outer(free, weighted)
    new = mean + gain @ innovation
    kept = np.eye(mean.size) - gain @ h
    covariance = kept @ p @ kept.T + gain @ noise @ gain.T
    return new, 0.5 * (covariance + covariance.T), float(innovation @ weighted)


def displacement_scores(strip: np.ndarray, block: int, kappa: float) -> np.ndarray:
    n_t, n_o = strip.shape[:2]
    out, k = np.empty((n_o, n_o)), np.arange(n_t - n_t % block)
    for a in range(n_o):
        for b in range(n_o):
            met = strip[k, np.floor(a + (b - a) * (k + 0.5) / n_t + 0.5).astype(int)]
            scores = (met.reshape(-1, block, 3).mean(axis=1) ** 2).sum(axis=1)
            scores = scores[np.isfinite(scores)]
            out[a, b] = np.mean(scores / (scores + kappa)) if 4 * scores.size * block >= n_t else -1.0
    return out


def line_energies(
    image: np.ndarray, rows: np.ndarray, columns: np.ndarray, slopes: np.ndarray, reaches: np.ndarray
) -> np.ndarray:
    whole = np.arange(int(np.ceil(rows[0])), int(np.floor(rows[1])) + 1)
    out = np.zeros(columns.size)
    for row in whole:
        reach = max(round(np.interp(row, rows, reaches)), 1)
        for i, (column, slope) in enumerate(zip(columns, slopes, strict=True)):
            place = round(column + slope * (row - 0.5 * (rows[0] + rows[1])))
            if place - reach >= 0 and place + reach < image.shape[1]:
                right = image[row, place + 1 : place + reach + 1].mean(axis=0)
                left = image[row, place - reach : place].mean(axis=0)
                out[i] -= 0.5 * np.sum((right - left) ** 2) / 255.0**2 / whole.size
    return out
