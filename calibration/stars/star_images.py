"""Stars in a picture: found by tetra3rs, then each fitted with the picture's own point spread.

The centre of mass of a faint star's thresholded pixels is some 0.1 px off; least squares with the shape that all stars
of a picture share come near to the Cramér-Rao bound (K. A. Winick, JOSA A 3, 1986), and give each its sigma.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import MissingExtraError

# half of a fitted window, px; it grows with stars that are drawn out or out of focus
_LEAST_HALF, _MOST_HALF = 5, 15
_WINDOW_SIGMAS = 3.0
_ROUNDS = 6
# brightest and faintest of those that tell the point spread are of no use: saturated, noisy
_SHAPE_STARS = 40
_LEAST_SHAPE_VARIANCE = 0.25
# a star's place within a pixel acts on a sampled Gaussian so much, px
_MODEL_SIGMA_PX = 0.03
_LEAST_SNR = 4.0
# a hot pixel, a satellite, two stars: what the shape leaves, in parts of the peak and of the noise
_WORST_MISFIT = 0.2
_MISFIT_SIGMAS = 4.0
_MOST_STARS = 400
_HOT_SIGMAS = 8.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarImages:
    """Stars of one picture, the brightest first.

    Attributes
    ----------
    pixel_px : (n, 2) u, v; ``sigma_px`` (n,) of each axis.
    flux : (n,) grey levels over the background, summed.
    spread_px : the point spread's sigma along its longer axis, px.
    noise : grey levels, one sigma of a pixel.
    """

    pixel_px: FloatArray
    sigma_px: FloatArray
    flux: FloatArray
    spread_px: float
    noise: float

    def __len__(self) -> int:
        return len(self.flux)


NO_STARS = StarImages(
    pixel_px=np.zeros((0, 2)), sigma_px=np.zeros(0), flux=np.zeros(0), spread_px=float("nan"), noise=float("nan")
)


def find_stars(grey: FloatArray, hot: MaskArray | None = None, most: int = _MOST_STARS) -> StarImages:
    """Find the stars of a grey picture (h, w) of any scale, of the brightest dots so many at ``most``.

    ``hot`` (h, w) marks pixels that are no use.
    Raises `MissingExtraError` without tetra3rs.
    """
    tetra3rs = load_tetra3rs()
    picture: FloatArray = np.asarray(grey, dtype=np.float64)
    if hot is not None and hot.any():
        picture = np.where(hot, _median(picture), picture)
    found = tetra3rs.extract_centroids(picture, max_centroids=most, threads=1)
    if not found.centroids:
        return NO_STARS
    h, w = picture.shape
    # its origin is the picture's centre
    place = np.array([(c.x + 0.5 * (w - 1), c.y + 0.5 * (h - 1)) for c in found.centroids])
    level = float(picture.max())
    # of integers the noise is not below what rounding makes
    noise = max(float(found.background_sigma), 12.0**-0.5)
    spread = _point_spread(picture, place, noise)
    stars = [_fit_star(picture, start, spread, noise, level) for start in place]
    rows = np.array([row for row in stars if row is not None]).reshape(-1, 4)
    rows = rows[np.argsort(-rows[:, 3], kind="stable")]
    return StarImages(
        pixel_px=rows[:, :2],
        sigma_px=rows[:, 2],
        flux=rows[:, 3],
        spread_px=float(np.sqrt(np.linalg.eigvalsh(spread)[-1])),
        noise=noise,
    )


def hot_pixels(darkest: FloatArray) -> MaskArray:
    """Return which pixels (h, w) are bright in every picture, by the least level (h, w) of each over all pictures.

    The sky turns and the head moves: what stays is the sensor's.
    """
    raised = darkest - _median(darkest)
    scatter = 1.4826 * float(np.median(np.abs(raised - np.median(raised))))
    return np.asarray(raised > max(_HOT_SIGMAS * scatter, 3.0))


def _median(picture: FloatArray) -> FloatArray:
    """Return the median of 5×5 pixels around each."""
    return cv2.medianBlur(np.asarray(picture, dtype=np.float32), 5).astype(np.float64)


def load_tetra3rs() -> Any:
    """Return the solver's module; raises `MissingExtraError`."""
    try:
        import tetra3rs
    except ImportError as fault:
        raise MissingExtraError("stars in pictures", "stars") from fault
    return tetra3rs


def _window(picture: FloatArray, centre: FloatArray, half: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return a window's levels, and u and v of its pixels, (k,) each; None beyond the border."""
    u, v = (int(x) for x in np.round(centre))
    h, w = picture.shape
    if not (half <= u < w - half and half <= v < h - half):
        return None
    levels = picture[v - half : v + half + 1, u - half : u + half + 1]
    across, down = _places(half)
    return levels.ravel(), u + across, v + down


@cache
def _places(half: int) -> tuple[FloatArray, FloatArray]:
    """Return how far a window's pixels (k,) are to the right of its middle, and below."""
    side = np.arange(-half, half + 1, dtype=np.float64)
    return np.tile(side, len(side)), np.repeat(side, len(side))


def _median_of_odd(values: FloatArray) -> float:
    """Return the median of an odd number of values, quicker than NumPy's."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def _gaussian(across: FloatArray, down: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return a Gaussian's values (k,), 1 in its middle, of pixels so far from it."""
    (a, b), (_, d) = inverse.tolist()
    return np.asarray(np.exp(-0.5 * (a * across * across + 2.0 * b * across * down + d * down * down)))


def _point_spread(picture: FloatArray, place: FloatArray, noise: float) -> FloatArray:
    """Return the covariance (2, 2), px², of the picture's star images: the median over bright ones.

    By moments weighted with a Gaussian of the same shape, iterated until they agree: the product of two equal Gaussians
    has half their covariance.
    """
    shapes = []
    for start in place[:_SHAPE_STARS]:
        shape, centre = 1.0 * np.eye(2), start
        for _ in range(_ROUNDS):
            half = int(np.clip(np.ceil(3.0 * np.sqrt(shape[[0, 1], [0, 1]].max())), _LEAST_HALF, _MOST_HALF))
            window = _window(picture, centre, half)
            if window is None:
                break
            level, u, v = window
            across, down = u - centre[0], v - centre[1]
            inverse = np.asarray(np.linalg.inv(shape), dtype=np.float64)
            weight = _gaussian(across, down, inverse) * np.maximum(level - _median_of_odd(level), 0.0)
            total = float(weight.sum())
            if total < _LEAST_SNR * noise:
                break
            off = np.stack([across, down])
            mean = off @ weight / total
            off -= mean[:, None]
            second = (off * weight) @ off.T / total
            centre = centre + mean
            shape = 2.0 * second + 1e-3 * np.eye(2)
        else:
            if np.all(np.linalg.eigvalsh(shape) > _LEAST_SHAPE_VARIANCE):
                shapes.append(shape)
    return np.median(shapes, axis=0) if shapes else np.eye(2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StarStep:
    """One step of a star's fit: the shift (2,), px; flux; what it leaves over (n,), and the derivatives (n, 4)."""

    shift_px: FloatArray
    flux: float
    left: FloatArray
    columns: FloatArray

    @property
    def worst(self) -> float:
        """The worst residual."""
        return float(np.abs(self.left).max())

    def sigmas(self, noise: float) -> tuple[float, float]:
        """Return one sigma of the flux, and one of the place, px."""
        scatter = max(noise, float(np.sqrt(np.mean(self.left**2))))
        covariance = np.linalg.pinv(self.columns.T @ self.columns) * scatter**2
        place = float(np.sqrt(0.5 * (covariance[1, 1] + covariance[2, 2])) / self.flux)
        return float(np.sqrt(covariance[0, 0])), place


def _fit_star(
    picture: FloatArray, start: FloatArray, spread: FloatArray, noise: float, full: float
) -> tuple[float, float, float, float] | None:
    """Return u, v, sigma and flux of a star by least squares, or None for what is none.

    Saturated pixels, those at the picture's highest level ``full``, are left out where a star has several.
    """
    half = int(np.clip(np.ceil(_WINDOW_SIGMAS * np.sqrt(np.diag(spread).max())), _LEAST_HALF, _MOST_HALF))
    inverse, centre = np.asarray(np.linalg.inv(spread), dtype=np.float64), start.copy()
    root = float(np.sqrt(np.linalg.det(inverse)))
    step: _StarStep | None = None
    for _ in range(_ROUNDS):
        window = _window(picture, centre, half)
        step = None if window is None else _star_step(window, centre, inverse, root, full)
        if step is None:
            return None
        length = float(np.hypot(*step.shift_px))
        # a pixel at most: the derivative holds no farther
        centre = centre + step.shift_px * min(1.0, 1.0 / max(length, 1e-9))
        if length < 1e-3:
            break
    if step is None:
        return None
    peak = step.flux * root / (2.0 * np.pi)
    misfit = max(_WORST_MISFIT * peak + _MISFIT_SIGMAS * noise, 2.0 * _MISFIT_SIGMAS * noise)
    flux_sigma, sigma_px = step.sigmas(noise)
    if step.flux < _LEAST_SNR * flux_sigma or float(np.hypot(*(centre - start))) > half or step.worst > misfit:
        return None
    return float(centre[0]), float(centre[1]), float(np.hypot(sigma_px, _MODEL_SIGMA_PX)), step.flux


def _star_step(
    window: tuple[FloatArray, FloatArray, FloatArray],
    centre: FloatArray,
    inverse: FloatArray,
    root: float,
    full: float,
) -> _StarStep | None:
    """Fit flux, flux times the shift, and a level of background; None where there is no light.

    ``root`` is that of the determinant of ``inverse``.
    """
    level, u, v = window
    off = np.stack([u - centre[0], v - centre[1]])
    columns = np.empty((4, len(level)))
    columns[0] = _gaussian(off[0], off[1], inverse) * (root / (2.0 * np.pi))
    columns[1:3] = (inverse @ off) * columns[0]
    columns[3] = 1.0
    if np.count_nonzero(level >= full) > 1:
        used = level < full
        columns, level = columns[:, used], level[used]
    # four well-conditioned columns: the normal equations do
    try:
        solved = np.linalg.solve(columns @ columns.T, columns @ level)
    except np.linalg.LinAlgError:
        return None
    if solved[0] <= 0.0:
        return None
    return _StarStep(
        shift_px=solved[1:3] / solved[0],
        flux=float(solved[0]),
        left=level - solved @ columns,
        columns=columns.T,
    )
