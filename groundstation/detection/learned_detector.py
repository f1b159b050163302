"""One camera's detector on the learned channel: windows around the prediction in, the pixel of the nose out.

The network's log odds drive the level set, which divides the window by them and its length term alone; the candidates
are its regions, weighed by their odds and their distance from the prediction. Size excludes none of them: it comes from
the filter, and scales the window.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray, MaskArray
from groundstation.box import Box, box_of_size
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, ChannelWindow, channel_window
from groundstation.detection.config import DetectionConfig, TargetPoint
from groundstation.detection.contour_evolution import settle_driven
from groundstation.detection.learned_channel import ChannelMaps, LearnedChannel, nose_of
from groundstation.detection.working_image import UNKNOWN_SPAN_PX, DetectionHint
from groundstation.files.channel_weights import channel_weights
from groundstation.messages import Detection, Miss, MissReason
from groundstation.picture import Picture, as_picture

# drive of the level set per unit of log odds, and where odds say no more; its length term stays the configured one
_DRIVE, _MOST_ODDS = 0.1, 6.0
# log odds by which an aircraft is likelier where the filter predicts one than where nothing is known: on 40 and 18
# train worlds hits rise from 85.3 to 86.6 and from 94.2 to 94.7 %, wrong points of the former from 3.9 to 4.2 % (4.5 %
# where the distance of these candidates did not count)
_EXPECTED_ODDS = 1.5
# one sigma of a nose from the middle of the silhouette, as a share of the width
_OFF_MIDDLE = 0.25
# regions nearer to each other than this share of the target are pieces of one
_PIECES = 0.35
# where nothing is more likely aircraft than not, windows are made for what is so much narrower as well: of thin wings,
# or wings as pale as the sky, a picture shows the fuselage. At the true place, aircraft below 32 px are known in 86 %
# instead of 66 %, of all 98.9 instead of 97.3 %; a look at nothing finds something in 5 % instead of 2 %
_NARROWER = 0.5
# neighbouring windows overlap by half of their width; at most so many to a side
_STEP, _MOST_WINDOWS = 0.5, 3
# one sigma of the nose, as a share of the width, where the map shows none, or the picture's border cuts the silhouette
_UNSEEN_NOSE = 0.2
_LEAST_NOSE_SHARE = 0.05
_NOSE_MARGIN = 0.2
# share of windows in which the map shows the other end of an obliquely seen fuselage, on the other side of the
# silhouette's centre: the most likely one for 1,193 windows of thirty train worlds that were not trained on
_OTHER_END = 0.05
# variance of a pixel's own rounding, window px²
_ROUNDING_PX2 = 1.0 / 12.0
# of the covariance, what is new in each frame
_NEW_SHARE = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelCandidate:
    """A region of one window.

    Attributes
    ----------
    mask : (96, 128) its pixels.
    odds : largest log odds in it.
    centre : (2,) of its pixels, window px.
    box : around them, window px.
    """

    mask: MaskArray
    odds: float
    centre: FloatArray
    box: Box[int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Best:
    """The likeliest candidate of some windows, by its ``score``, with its window and that one's maps."""

    score: float
    candidate: ChannelCandidate
    window: ChannelWindow
    maps: ChannelMaps


class LearnedDetector:
    """Finds the target of one camera, frame after frame, with the learned channel."""

    def __init__(self, config: DetectionConfig, image_size_px: tuple[int, int]) -> None:
        self._config = config
        self._image_size_px = image_size_px
        self._channel = LearnedChannel(channel_weights(config.weights_sha256))
        self._width_px: float | None = None

    def reset(self) -> None:
        """Discard the size of the target."""
        self._width_px = None

    @contextmanager
    def state_preserved(self) -> Iterator[None]:
        """Detect without learning inside the block."""
        width = self._width_px
        yield
        self._width_px = width

    def detect(self, image: ImageArray | Picture, roi: Box[int], hint: DetectionHint) -> Detection | Miss:
        """Detect the target near its prediction, in windows that begin inside ``roi``."""
        picture = as_picture(image)
        span = self._span(hint)
        best = self._best(picture, hint, span, _centres(hint, roi, span))
        if best is None or best.candidate.odds <= 0.0:
            narrow = max(_NARROWER * span, self._config.min_span_px)
            narrower = self._best(picture, hint, span, [(_inside(hint.predicted_px, roi), narrow)], weaker=False)
            best = max((b for b in (best, narrower) if b is not None), key=lambda b: b.score, default=None)
        if best is None:
            return Miss(reason=MissReason.LOW_CONTRAST, detail="no response to aircraft near the prediction")
        if _distance(best.window, best.candidate, hint, span) > self._config.gate_sigmas**2:
            return Miss(reason=MissReason.NO_REGION, detail="the nearest region is too far from the prediction")
        return self._described(best.candidate, best.window, best.maps, span)

    def _best(
        self,
        picture: Picture,
        hint: DetectionHint,
        span: float,
        places: Iterable[tuple[FloatArray, float]],
        *,
        weaker: bool = True,
    ) -> _Best | None:
        """Return the likeliest target in windows at ``places``, their middles and spans, if there is any.

        ``weaker``: one less likely aircraft than not counts as well, where it is expected.
        """
        best: _Best | None = None
        for centre, window_span in places:
            window = channel_window(picture, centre, window_span)
            if window is None:
                continue
            maps = self._channel.maps(window.image)
            for score, candidate in self._scored(maps, window, hint, span, weaker=weaker):
                if best is None or score > best.score:
                    best = _Best(score=score, candidate=candidate, window=window, maps=maps)
        return best

    def _scored(
        self, maps: ChannelMaps, window: ChannelWindow, hint: DetectionHint, span: float, *, weaker: bool
    ) -> Iterator[tuple[float, ChannelCandidate]]:
        """Yield the candidates of a window, each with its odds less its distance from the prediction.

        Where none is more likely aircraft than not, ``weaker`` ones count that are likely so where the target is
        expected: the less well known that place is, the less likely.
        """
        mu = self._config.level_set.mu
        candidates = candidates_of(maps, mu)
        least = -math.inf
        if not candidates and weaker:
            least = math.log(_vagueness(hint, span)) - _EXPECTED_ODDS
            candidates = candidates_of(maps, mu, _EXPECTED_ODDS)
        for candidate in candidates:
            score = candidate.odds - 0.5 * _distance(window, candidate, hint, span)
            if score > least:
                yield score, candidate

    def _span(self, hint: DetectionHint) -> float:
        """Return the width to expect, px: the filter's where it is better known than the last one's."""
        expected = hint.expected_span_px
        if expected is not None and (self._width_px is None or hint.span_sigma_ratio < 0.3):
            return max(expected, self._config.min_span_px)
        return self._width_px if self._width_px is not None else UNKNOWN_SPAN_PX

    def _described(
        self, candidate: ChannelCandidate, window: ChannelWindow, maps: ChannelMaps, span: float
    ) -> Detection | Miss:
        """Return a candidate as a detection; ``span`` is the width that was expected, px."""
        point, covariance = nose_in(maps, candidate)
        if self._config.target_point is TargetPoint.CENTROID:
            point = candidate.centre
        u, v = window.to_picture(point)
        box = candidate.box
        (x0, y0), (x1, y1) = (window.to_picture(np.array(c) - 0.5) for c in ((box.x0, box.y0), (box.x1, box.y1)))
        w, h = self._image_size_px
        if not (-0.5 <= u <= w - 0.5 and -0.5 <= v <= h - 0.5):
            return Miss(reason=MissReason.CUT, detail="the image border cuts the nose off")
        cut = x0 <= 0.5 or y0 <= 0.5 or x1 >= w - 1.5 or y1 >= h - 1.5
        covariance = covariance / window.scale**2
        # a window repeats the picture's border, and a region may go on in it
        x0, y0, x1, y1 = max(x0, -0.5), max(y0, -0.5), min(x1, w - 0.5), min(y1, h - 0.5)
        if cut:
            # the nose may be in the part that is outside the picture
            missing = max(span - float(x1 - x0), 0.0)
            covariance = covariance + np.eye(2) * (_UNSEEN_NOSE * span) ** 2 + np.diag([(0.5 * missing) ** 2, 0.0])
        else:
            self._width_px = max(float(x1 - x0), 1.0)
        return Detection(
            u_px=float(u),
            v_px=float(v),
            covariance_px2=covariance,
            noise_px2=_NEW_SHARE * covariance,
            centroid_px=window.to_picture(candidate.centre),
            box=box_of_size(float(x0), float(y0), float(x1 - x0), float(y1 - y0)),
            area_px=float(candidate.mask.sum()) / window.scale**2,
            contour_px=_outline(candidate.mask, window),
            contrast_to_noise=candidate.odds,
            channel="learned",
            cut=bool(cut),
            log_odds=candidate.odds,
        )


def candidates_of(maps: ChannelMaps, mu: float, prior: float = 0.0) -> list[ChannelCandidate]:
    """Return the regions into which the level set divides a window by its log odds.

    ``mu`` weighs its length; ``prior`` is added to the odds, and not to those of the candidates.
    """
    odds = np.clip(maps.aircraft + np.float32(prior), -_MOST_ODDS, _MOST_ODDS)
    drive = np.ascontiguousarray(_DRIVE * odds, np.float32)
    phi = np.where(drive > 0.0, np.float32(1.0), np.float32(-1.0))
    settle_driven(drive, phi, mu)
    inside = phi > 0.0
    reach = max(round(0.5 * _PIECES * TARGET_PX), 1)
    near = cv2.dilate(inside.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=8)
    found = []
    for number in range(1, count):
        mask = inside & (labels == number)
        rows, columns = np.nonzero(mask)
        if rows.size == 0:
            continue
        box = Box(int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        found.append(
            ChannelCandidate(
                mask=mask,
                odds=float(maps.aircraft[mask].max()),
                centre=np.array([columns.mean(), rows.mean()]),
                box=box,
            )
        )
    return found


def nose_in(maps: ChannelMaps, candidate: ChannelCandidate) -> tuple[FloatArray, FloatArray]:
    """Return a candidate's nose (2,) and its covariance (2, 2), window px, by the part of the nose map around it."""
    box, margin = candidate.box, math.ceil(_NOSE_MARGIN * TARGET_PX)
    rows = slice(max(box.y0 - margin, 0), box.y1 + margin)
    columns = slice(max(box.x0 - margin, 0), box.x1 + margin)
    own: Float32Array = np.zeros_like(maps.nose)
    own[rows, columns] = maps.nose[rows, columns]
    share = float(own.sum())
    if share < _LEAST_NOSE_SHARE:
        width = box.x1 - box.x0
        return candidate.centre, np.eye(2) * (_UNSEEN_NOSE * width) ** 2
    mean, covariance = nose_of(own / share)
    covariance += _ROUNDING_PX2 * np.eye(2)
    covariance[0, 0] += 4.0 * _OTHER_END * (1.0 - _OTHER_END) * float(candidate.centre[0] - mean[0]) ** 2
    return mean, covariance


def _centres(hint: DetectionHint, roi: Box[int], span_px: float) -> Iterator[tuple[FloatArray, float]]:
    """Yield the middles of the windows that hold two sigmas of the prediction, its own first, with their span."""
    size = np.array(WINDOW_PX) * span_px / TARGET_PX
    step, room = _STEP * float(size[0]), 0.5 * (size - span_px)
    sigma = np.sqrt(np.diag(hint.predicted_covariance_px2))
    sides = np.clip(np.ceil((2.0 * sigma - room) / step), 0, (_MOST_WINDOWS - 1) // 2).astype(int)
    offsets = [(i, j) for i in range(-sides[0], sides[0] + 1) for j in range(-sides[1], sides[1] + 1)]
    middle = _inside(hint.predicted_px, roi)
    for i, j in sorted(offsets, key=lambda each: abs(each[0]) + abs(each[1])):
        centre = middle + step * np.array([i, j])
        if roi.x0 <= centre[0] < roi.x1 and roi.y0 <= centre[1] < roi.y1:
            yield centre, span_px


def _inside(point_px: FloatArray, roi: Box[int]) -> FloatArray:
    """Return a point (2,) moved into a region: it may be outside the picture that shows the rest of the aircraft."""
    return np.clip(point_px, (roi.x0, roi.y0), (roi.x1 - 1, roi.y1 - 1))


def _spread(hint: DetectionHint, span_px: float) -> FloatArray:
    """Return the covariance (2, 2) of a target's middle about the prediction: its nose may be off its middle."""
    return hint.predicted_covariance_px2 + np.eye(2) * (_OFF_MIDDLE * span_px) ** 2


def _vagueness(hint: DetectionHint, span_px: float) -> float:
    """Return over how large an area a target may be, as a multiple of that of a prediction without any error."""
    return math.sqrt(float(np.linalg.det(_spread(hint, span_px)))) / (_OFF_MIDDLE * span_px) ** 2


def _distance(window: ChannelWindow, candidate: ChannelCandidate, hint: DetectionHint, span_px: float) -> float:
    """Return the squared distance of a candidate from the prediction, in sigmas."""
    away = window.to_picture(candidate.centre) - hint.predicted_px
    return float(away @ np.linalg.solve(_spread(hint, span_px), away))


def _outline(mask: MaskArray, window: ChannelWindow) -> Float32Array:
    """Return the outline in picture pixels, pieces separated by a row of NaN."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    pieces = []
    for contour in contours:
        pieces += [window.to_picture(contour[:, 0].astype(np.float64)), np.full((1, 2), np.nan)]
    return np.concatenate(pieces[:-1]).astype(np.float32) if pieces else np.empty((0, 2), np.float32)
