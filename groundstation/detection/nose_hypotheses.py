"""Where the nose of a candidate is: what the nose map shows, or else what outline and direction of flight leave.

A nose map is a probability over a window, and sometimes it is wrong: it shows the other end of a fuselage, or the fins.
Where the direction of flight is known there are therefore two hypotheses. By the first one the map is right; by the
second one the nose is somewhere in the silhouette. How likely each is follows from that direction: an aircraft flies
with its nose ahead. The filter's prediction, which contains what other cameras show, weighs them afterwards.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray
from groundstation.detection.channel_candidate import ChannelCandidate
from groundstation.detection.channel_window import TARGET_PX
from groundstation.detection.learned_channel import ChannelMaps, nose_of
from groundstation.messages import PointHypothesis

# the part of the map that belongs to a candidate: around its box, by this share of the target; with less of the map
# in it, the map shows no nose, which is off the silhouette's middle by a share of its width, one sigma
_MARGIN, _LEAST_SHARE, UNSEEN_NOSE = 0.2, 0.05, 0.2
# share of windows in which the map shows the other end of an obliquely seen fuselage, on the other side of the
# silhouette's centre: the most likely one for 1,193 windows of thirty train worlds that were not trained on
_OTHER_END = 0.05
# where the direction of flight is known: probability that a map is wrong, and the power of it that is a probability of
# the nose. The most likely ones for the noses of 6,000 windows of 46 train worlds not trained on, and the power again
# for these weights (docs/notes/detection.md)
_WRONG_MAP, _EXPONENT = 0.08, 0.9
# the nose is so far ahead of the silhouette's middle, in spans, one sigma, and one sigma across, there as well
_AHEAD, _AHEAD_SIGMA, _ACROSS_SIGMA = 0.4, 0.15, 0.07
# probability that a target does not fly with its nose ahead
_NOT_AHEAD = 0.02
# likelihood of a nose outside of the level set's silhouette, over that of one within: a choice by train worlds
# (docs/notes/detection.md)
_OUTSIDE = 0.3
# a direction that is less certain says nothing
_MOST_SIGMA_RAD = 0.5
# variance of a pixel's own rounding, window px²
_ROUNDING_PX2 = 1.0 / 12.0
_LEAST = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedHeading:
    """A direction of flight in a window: (2,) px of one span ahead, a span in px, and one sigma of the direction."""

    ahead_px: FloatArray
    span_px: float
    sigma_rad: float


def is_known(direction_sigma_rad: float) -> bool:
    """Return whether a direction of flight with this sigma says where the nose is."""
    return direction_sigma_rad <= _MOST_SIGMA_RAD


def nose_in(maps: ChannelMaps, candidate: ChannelCandidate) -> tuple[FloatArray, FloatArray]:
    """Return a candidate's nose (2,) and its covariance (2, 2), window px, by the part of the nose map around it."""
    rows, columns = _around(candidate)
    own: Float32Array = np.zeros_like(maps.nose)
    own[rows, columns] = maps.nose[rows, columns]
    share = float(own.sum())
    if share < _LEAST_SHARE:
        width = candidate.box.x1 - candidate.box.x0
        return candidate.centre, np.eye(2) * (UNSEEN_NOSE * width) ** 2
    mean, covariance = nose_of(own / share)
    covariance += _ROUNDING_PX2 * np.eye(2)
    covariance[0, 0] += 4.0 * _OTHER_END * (1.0 - _OTHER_END) * float(candidate.centre[0] - mean[0]) ** 2
    return mean, covariance


def nose_hypotheses(maps: ChannelMaps, candidate: ChannelCandidate, heading: ExpectedHeading) -> list[PointHypothesis]:
    """Return where a candidate's nose may be, window px, the likeliest first; their probabilities have the sum 1."""
    rows, columns = _around(candidate)
    shown = maps.nose[rows, columns].astype(np.float64)
    right = (1.0 - _WRONG_MAP) * min(float(shown.sum()), 1.0)
    shown **= _EXPONENT
    corner = np.array([columns.start, rows.start], np.float64)
    outline = cv2.dilate(candidate.mask[rows, columns].astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float64)
    by_flight = _ahead(candidate.centre - corner, heading, outline / outline.sum())
    # a nose is within the silhouette, unless the level set has missed it
    by_flight *= np.where(outline > 0.0, 1.0, _OUTSIDE)
    found = []
    for probability, density in ((right, shown), (1.0 - right, outline)):
        evidence = density * by_flight
        mass = float(evidence.sum())
        weight = probability * mass / max(float(density.sum()), _LEAST)
        if weight > _LEAST:
            mean, covariance = nose_of((evidence / mass).astype(np.float32))
            covariance += _ROUNDING_PX2 * np.eye(2)
            found.append((weight, mean + corner, covariance))
    total = sum(weight for weight, _, _ in found)
    return sorted(
        (PointHypothesis(pixel=m, covariance_px2=P, probability=weight / total) for weight, m, P in found),
        key=lambda h: -h.probability,
    )


def _around(candidate: ChannelCandidate) -> tuple[slice, slice]:
    """Return the rows and columns of a window that belong to a candidate."""
    box, margin = candidate.box, math.ceil(_MARGIN * TARGET_PX)
    return slice(max(box.y0 - margin, 0), box.y1 + margin), slice(max(box.x0 - margin, 0), box.x1 + margin)


def _ahead(middle: FloatArray, heading: ExpectedHeading, outline: FloatArray) -> FloatArray:
    """Return the density (h, w) of the nose by the direction of flight, for a silhouette with this ``middle`` (2,)."""
    across_px2 = (_ACROSS_SIGMA * heading.span_px) ** 2 + (_AHEAD * heading.span_px * heading.sigma_rad) ** 2
    spread = _AHEAD_SIGMA**2 * np.outer(heading.ahead_px, heading.ahead_px)
    spread += (across_px2 + _ROUNDING_PX2) * np.eye(2)
    ahead = _normal(outline.shape, middle + _AHEAD * heading.ahead_px, spread)
    return np.asarray((1.0 - _NOT_AHEAD) * ahead + _NOT_AHEAD * outline)


def _normal(shape: tuple[int, ...], mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the density of a normal distribution at the pixels (h, w) of a part of a window."""
    u, v = np.arange(shape[1]) - mean[0], np.arange(shape[0])[:, None] - mean[1]
    (a, b), (_, c) = np.linalg.inv(covariance)
    squares = a * u * u + 2.0 * b * u * v + c * v * v
    return np.asarray(np.exp(-0.5 * squares) / (2.0 * math.pi * math.sqrt(float(np.linalg.det(covariance)))))


def likeliest(hypotheses: Sequence[PointHypothesis]) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest point (2,), and the mean square (2, 2) of all hypotheses about it as its covariance."""
    best = max(hypotheses, key=lambda h: h.probability)
    return best.pixel, mean_square_about(best.pixel, hypotheses)


def mean_square_about(point_px: FloatArray, hypotheses: Sequence[PointHypothesis]) -> FloatArray:
    """Return the mean square (2, 2) of hypotheses about a point (2,)."""
    covariance = np.zeros((2, 2))
    for each in hypotheses:
        away = each.pixel - point_px
        covariance += each.probability * (each.covariance_px2 + np.outer(away, away))
    return covariance
