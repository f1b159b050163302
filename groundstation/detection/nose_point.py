"""The target point of a silhouette: the centre of the aircraft's nose, with its uncertainty.

The fuselage is found by the best fit of a disc of its own radius: thin parts (wing, tail, gear) fill little of it.
Nearly head-on the best position of that disc is the nose itself; from the side or from below the
fuselage is a strip, and the nose is its forward end.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.detection.disc_response import disc_maximum
from groundstation.detection.fuselage import locate_nose, trace
from groundstation.detection.point_noise import uncorrelated_covariance
from groundstation.detection.wing_line import extent, level_frame

_RADIUS_PER_SPAN = 0.07
_CORE_PER_SPAN = 0.025  # half width of the fuselage's core
_SHAPE_PER_SPAN = 0.0042
_LEAD_SIGMA_PER_SPAN = 0.06
_CRAB_SIGMA_RAD = math.radians(3.0)
_WING_PER_SPAN = 0.04  # behind this the wing no longer hides the fuselage's sides
_TAIL_PER_SPAN = 0.35  # from the thickest part to ahead of the tailplane
_WIDEST_PER_SPAN = 0.13
_MIN_TAIL_PX = 10.0
_END_ON = 0.3  # shorter images of a length than this do not show the fuselage's forward end
_LEAD_PER_SPAN = 0.26  # nose to the thickest part of the fuselage, at the wing
_UNKNOWN_HEADING = 0.25
_SIDE_ON = 0.8
_TIP_PER_SPAN = 0.006
_BODY_ASIDE = 0.035
_BODY_SIGMA_PER_SPAN = 0.04
_MISFIT_SHARE = 0.12
_INCIDENCE_RAD = math.radians(5.0)  # how far the body is usually pitched above its path in flight
_ROLLING_PER_SPAN, _FLYING_PER_SPAN = 0.15, 0.45  # height of the nose above the runway
_ROLLING_CRAB_SIGMA, _CRAB_SIGMA = math.radians(3.0), math.radians(6.5)
_PITCH_SIGMA = math.radians(2.5)
_CRAB_FROM_PX, _CRAB_SURE_PX = 60.0, 110.0  # spans between which crab becomes legible
_SMALL_FLYING = 0.5  # measured variance over that of the parts
_NOISE_PX_SIGMAS = 3.0  # px, over contrast
_EDGE_PX, _EDGE_PX_SIGMAS = 0.2, 3.0  # sigma of an edge's place: best, and as noise over contrast


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NosePoint:
    """A target point (2,) in working pixels with its covariance (2, 2), of which ``noise`` is new in each frame."""

    point: FloatArray
    covariance: FloatArray
    noise: FloatArray


def find_nose(
    membership: NDArray[np.float32],
    span: float,
    contrast: float,
    forward_per_span: FloatArray | None,
    up: FloatArray | None,
    expected: tuple[float, float] | None = None,
    height_per_span: float | None = None,
    scale: int = 1,
) -> NosePoint:
    """Return the nose of one silhouette.

    Parameters
    ----------
    membership : (h, w) in [0, 1], soft silhouette with at least a disc of empty rim.
    span : px, the aircraft's wing span here.
    contrast : of the silhouette, in sigmas.
    forward_per_span : (2,) image shift in px of one span's length along the flight direction, or None.
    up : (2,) image shift in px of one span's length of runway-up, or None.
    expected : the span to expect in px and the sigma of its logarithm, or None.
    height_per_span : of the nose above the runway, in spans, or None.
    scale : how many of the camera's px one px here is; all lengths above are in px here.
    """
    thickest = disc_maximum(membership, max(_RADIUS_PER_SPAN * span, 1.2))
    noise = (0.15 + _NOISE_PX_SIGMAS / max(contrast, 1.0)) ** 2
    covariance = (noise + (_SHAPE_PER_SPAN * span) ** 2) * np.eye(2)
    if forward_per_span is None:
        # the nose may be anywhere within the lead of an aircraft seen some 15° off its axis
        unknown = (_UNKNOWN_HEADING * _LEAD_PER_SPAN * span) ** 2 * np.eye(2)
        new = uncorrelated_covariance(noise, unknown, contrast, 0.0)
        return NosePoint(point=thickest, covariance=covariance + unknown, noise=new)
    airborne = _airborne(height_per_span)
    forward = forward_per_span
    if up is not None:
        forward = forward + math.sin(airborne * _INCIDENCE_RAD) * up
    if math.hypot(float(forward[0]), float(forward[1])) < _SIDE_ON * span:
        point, attitude = _near_head_on(membership, thickest, forward, (span, contrast, scale), (expected, airborne))
    else:
        forward, forward_covariance = _fuselage_axis(membership, thickest, forward, span)
        lead_error = _LEAD_SIGMA_PER_SPAN * forward
        attitude = np.outer(lead_error, lead_error) + _LEAD_PER_SPAN**2 * forward_covariance
        point = thickest + _lead(membership, thickest, forward, span) * forward
    new = uncorrelated_covariance(noise, attitude, contrast, _legible(scale * span))
    return NosePoint(point=point, covariance=covariance + attitude, noise=new)


def _near_head_on(
    membership: NDArray[np.float32],
    thickest: FloatArray,
    forward: FloatArray,
    seen: tuple[float, float, int],
    known: tuple[tuple[float, float] | None, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the nose (2,) and its covariance (2, 2) of an aircraft whose wing is seen in its full width.

    ``seen`` is the silhouette's width, its contrast and how many of the camera's px one px is, ``forward`` (2,) the
    expected image of the body axis, px per that width, ``known`` the expected span with its log-sigma and how surely
    it flies.
    """
    width, contrast, scale = seen
    expected, airborne = known
    edge = _EDGE_PX + _EDGE_PX_SIGMAS / max(contrast, 1.0)
    span = _likely_span(width, expected)
    # where crab is observable it is estimated; otherwise an approach in usual wind is assumed. The blur is that of
    # the camera, not of the reduced picture in which a large silhouette is processed
    legible = _legible(scale * span)
    back, size, wing_seen = level_frame(membership, float(thickest[0]), span)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    level = np.asarray(cv2.warpAffine(membership, back, size, flags=flags), np.float32)
    span_of = (width, span, expected is not None)
    return _nose_in(level, back, thickest, forward, span_of, wing_seen, edge, (airborne, legible))


@njit(cache=True, nogil=True)
def _nose_in(
    level: NDArray[np.float32],
    back: FloatArray,
    thickest: FloatArray,
    forward: FloatArray,
    span_of: tuple[float, float, bool],
    wing_seen: bool,
    edge: float,
    flight: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the nose (2,) and its covariance (2, 2) in working px, from the silhouette turned level.

    ``back`` (2, 3) leads from the level picture to working px, ``span_of`` is the silhouette's width, the likely span
    and whether that was expected, ``edge`` the sigma of an edge's place, ``flight`` how surely it flies and how legible
    crab is.
    """
    width, span, was_expected = span_of
    airborne, legible = flight
    cos, sin = back[0, 0], back[1, 0]
    away_x, away_y = thickest[0] - back[0, 2], thickest[1] - back[1, 2]
    body, thickest_t = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    tips, band = extent(level, body, span)
    rows, ends = trace(level, (body, thickest_t), band, span)
    middle, middle_sigma = body, _BODY_SIGMA_PER_SPAN * span
    if wing_seen:
        middle = 0.5 * (tips[0] + tips[1])
        lost = 0.5 * abs(tips[1] - tips[0] - span) if was_expected else 0.03 * span
        # a body far from the middle means that a tip is hidden or not the wing's
        lost += max(abs(middle - body) - _BODY_ASIDE * span, 0.0)
        middle_sigma = math.sqrt(edge**2 + (_TIP_PER_SPAN * span) ** 2 + lost**2)
    along_s = (cos * forward[0] + sin * forward[1]) * (span / width)
    along_t = (cos * forward[1] - sin * forward[0]) * (span / width)
    flying = _CRAB_SIGMA_RAD + min(2.0 * legible, 1.0) * (_CRAB_SIGMA - _CRAB_SIGMA_RAD)
    crab = _ROLLING_CRAB_SIGMA + airborne * (flying - _ROLLING_CRAB_SIGMA)
    sigma = (crab * span, _PITCH_SIGMA * span)
    nose, covariance = locate_nose(
        rows, ends, (middle, middle_sigma), thickest_t, (along_s, along_t), sigma, (span, edge)
    )
    # crab is estimated from the fuselage's rows: for a small silhouette they are less accurate than its thickest part
    s, t = legible * nose[0] + (1.0 - legible) * (body + _LEAD_PER_SPAN * along_s), nose[1]
    # as measured on rendered flights: of a small silhouette in flight the parts agree better than each of them alone
    covariance *= 1.0 + airborne * (1.0 - legible) * (_SMALL_FLYING - 1.0)
    # a silhouette of the wrong width has lost or gained more than its tips
    misfit = (_MISFIT_SHARE * (width - span)) ** 2
    ss, tt, st = covariance[0, 0] + misfit, covariance[1, 1] + misfit, covariance[0, 1]
    turned = np.empty((2, 2))
    turned[0, 0] = cos * cos * ss - 2.0 * cos * sin * st + sin * sin * tt
    turned[1, 1] = sin * sin * ss + 2.0 * cos * sin * st + cos * cos * tt
    turned[0, 1] = turned[1, 0] = cos * sin * (ss - tt) + (cos * cos - sin * sin) * st
    return np.array([cos * s - sin * t + back[0, 2], sin * s + cos * t + back[1, 2]]), turned


def _legible(span_px: float) -> float:
    """Return from 0 to 1 the observability of crab in a silhouette of this span, in the camera's px."""
    return min(max((span_px - _CRAB_FROM_PX) / (_CRAB_SURE_PX - _CRAB_FROM_PX), 0.0), 1.0)


def _airborne(height_per_span: float | None) -> float:
    """Return 0 for a rolling aircraft, 1 for a flying one, a value between where the height is ambiguous."""
    if height_per_span is None:
        return 0.5
    share = (height_per_span - _ROLLING_PER_SPAN) / (_FLYING_PER_SPAN - _ROLLING_PER_SPAN)
    return min(max(share, 0.0), 1.0)


def _likely_span(width: float, expected: tuple[float, float] | None) -> float:
    """Return the span in px from a silhouette's width and its expected value: a lost wing makes it too narrow."""
    if expected is None:
        return width
    deviation = math.log(expected[0] / width)
    own = (0.02 + 1.5 / width + 1.5 * abs(deviation)) ** 2
    return width * math.exp(deviation * own / (own + expected[1] ** 2))


def _lead(membership: NDArray[np.float32], thickest: FloatArray, forward: FloatArray, span: float) -> float:
    """Return the distance of the nose ahead of the thickest part, in spans: the fuselage's end where visible."""
    length = float(np.hypot(*forward))
    half = _CORE_PER_SPAN * span
    if length < _END_ON * span or half < 1.0:
        return _LEAD_PER_SPAN
    along = forward / length
    across = np.array([-along[1], along[0]])
    t = np.arange(0.0, 2.0 * _LEAD_PER_SPAN * length, 0.5)
    s = np.arange(-half, half + 0.5)
    xs = (thickest[0] + t[:, None] * along[0] + s[None, :] * across[0]).astype(np.float32)
    ys = (thickest[1] + t[:, None] * along[1] + s[None, :] * across[1]).astype(np.float32)
    strip = cv2.remap(membership, xs, ys, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT).mean(axis=1)
    beyond = np.flatnonzero(strip < 0.5 * max(float(strip[: max(t.size // 4, 1)].mean()), 1e-6))
    end = float(t[beyond[0]]) / length if beyond.size else _LEAD_PER_SPAN
    return min(max(end, 0.5 * _LEAD_PER_SPAN), 1.4 * _LEAD_PER_SPAN)


def _fuselage_axis(
    membership: NDArray[np.float32], thickest: FloatArray, forward: FloatArray, span: float
) -> tuple[FloatArray, FloatArray]:
    """Correct the image of the flight direction by the fuselage seen behind the wing.

    An aircraft does not point exactly where it flies: crab and incidence are some degrees. Returns the shift
    of one span along the fuselage (2,) and its covariance (2, 2).
    """
    prior = (_CRAB_SIGMA_RAD * span) ** 2
    length = float(np.hypot(*forward))
    visible = _TAIL_PER_SPAN * length
    if visible < _MIN_TAIL_PX:
        return forward, prior * np.eye(2)
    direction = forward / length
    turn = 0.0
    for half in (0.14 * span, 0.08 * span, 0.08 * span):
        cos, sin = math.cos(turn), math.sin(turn)
        along = np.array([cos * direction[0] - sin * direction[1], sin * direction[0] + cos * direction[1]])
        across = np.array([-along[1], along[0]])
        t = np.arange(_WING_PER_SPAN * span, visible, dtype=np.float32)
        s = np.arange(-half, half + 0.5, dtype=np.float32)
        if t.size < 4:
            return forward, prior * np.eye(2)
        xs = (thickest[0] - t[:, None] * along[0] + s[None, :] * across[0]).astype(np.float32)
        ys = (thickest[1] - t[:, None] * along[1] + s[None, :] * across[1]).astype(np.float32)
        strip = cv2.remap(membership, xs, ys, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        mass = strip.sum(axis=1)
        # rows across the wing, the tailplane or the gear do not show the fuselage's position
        weight = np.where(mass < _WIDEST_PER_SPAN * span, mass, 0.0)
        offset = (strip @ s) / np.maximum(mass, 1e-6)
        strength = float(weight @ (t * t))
        if strength <= 1e-6 or float((weight > 1.0).mean()) < 0.4:
            return forward, prior * np.eye(2)
        turn -= math.atan(float(weight @ (t * offset)) / strength)
    # the lateral part is measured to about a pixel at the far end, or a fiftieth of the span
    measured = ((1.0 + 0.02 * span) / visible * length) ** 2
    gain = prior / (prior + measured)
    shift = math.atan(gain * math.tan(min(max(turn, -0.7), 0.7)))
    cos, sin = math.cos(shift), math.sin(shift)
    turned = np.array([cos * forward[0] - sin * forward[1], sin * forward[0] + cos * forward[1]])
    across = np.array([-turned[1], turned[0]]) / length
    along = turned / length
    return turned, (1.0 - gain) * prior * np.outer(across, across) + prior * np.outer(along, along)
