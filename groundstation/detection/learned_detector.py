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
from groundstation.detection.channel_candidate import ChannelCandidate, candidates_of
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, ChannelWindow, channel_window
from groundstation.detection.config import DetectionConfig, TargetPoint
from groundstation.detection.learned_channel import ChannelMaps, LearnedChannel
from groundstation.detection.nose_hypotheses import UNSEEN_NOSE, ExpectedHeading, is_known, nose_hypotheses, nose_in
from groundstation.detection.working_image import UNKNOWN_SPAN_PX, DetectionHint
from groundstation.files.channel_weights import channel_weights
from groundstation.messages import Detection, Miss, MissReason, PointHypothesis
from groundstation.picture import Picture, as_picture

# log odds by which an aircraft is likelier where the filter predicts one than where nothing is known: on 40 and 18
# train worlds hits rise from 85.3 to 86.6 and from 94.2 to 94.7 %, wrong points of the former from 3.9 to 4.2 % (4.5 %
# where the distance of these candidates did not count)
_EXPECTED_ODDS = 1.5
# one sigma of a nose from the middle of the silhouette, as a share of the width
_OFF_MIDDLE = 0.25
# a target that has more pixels is this wide in its window. Of seven widths it has the least error of the nose from 40
# px on, up to 17 % less than 44 px, and is seen more often (1,700 pictures of 56 train worlds not trained on). But it
# is more often at the wrong end of the aircraft: only where the direction of flight tells which one that is
_FINEST_TARGET_PX = 63.0
# where nothing is more likely aircraft than not, windows are made for what is so much narrower as well: of thin wings,
# or wings as pale as the sky, a picture shows the fuselage. At the true place, aircraft below 32 px are known in 86 %
# instead of 66 %, of all 98.9 instead of 97.3 %; a look at nothing finds something in 5 % instead of 2 %
_NARROWER = 0.5
# neighbouring windows overlap by half of their width; at most so many to a side
_STEP, _MOST_WINDOWS = 0.5, 3
# of the covariance, what is new in each frame
_NEW_SHARE = 0.3


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
        window_span = _window_span(span, hint)
        centres = _centres(hint, roi, span, window_span if _holds(hint, span, window_span) else span)
        best = self._best(picture, hint, span, centres)
        if best is None or best.candidate.odds <= 0.0:
            window_span = _window_span(max(_NARROWER * span, self._config.min_span_px), hint)
            narrower = self._best(picture, hint, span, [(_inside(hint.predicted_px, roi), window_span)], weaker=False)
            best = max((b for b in (best, narrower) if b is not None), key=lambda b: b.score, default=None)
        if best is None:
            return Miss(reason=MissReason.LOW_CONTRAST, detail="no response to aircraft near the prediction")
        if _distance(best.window, best.candidate, hint, span) > self._config.gate_sigmas**2:
            return Miss(reason=MissReason.NO_REGION, detail="the nearest region is too far from the prediction")
        return self._described(best, span, hint)

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

    def _described(self, best: _Best, span: float, hint: DetectionHint) -> Detection | Miss:
        """Return a candidate as a detection; ``span`` is the width that was expected, px."""
        candidate, window = best.candidate, best.window
        box = candidate.box
        (x0, y0), (x1, y1) = (window.to_picture(np.array(c) - 0.5) for c in ((box.x0, box.y0), (box.x1, box.y1)))
        w, h = self._image_size_px
        cut = x0 <= 0.5 or y0 <= 0.5 or x1 >= w - 1.5 or y1 >= h - 1.5
        # a window repeats the picture's border, and a region may go on in it
        x0, y0, x1, y1 = max(x0, -0.5), max(y0, -0.5), min(x1, w - 0.5), min(y1, h - 0.5)
        missing_px2 = np.zeros((2, 2))
        if cut:
            # the nose may be in the part that is outside the picture
            missing = max(span - float(x1 - x0), 0.0)
            missing_px2 = np.eye(2) * (UNSEEN_NOSE * span) ** 2 + np.diag([(0.5 * missing) ** 2, 0.0])
        point, covariance = nose_in(best.maps, candidate)
        if self._config.target_point is TargetPoint.CENTROID:
            point = candidate.centre
        u, v = window.to_picture(point)
        covariance = covariance / window.scale**2 + missing_px2
        if not (-0.5 <= u <= w - 0.5 and -0.5 <= v <= h - 0.5):
            return Miss(reason=MissReason.CUT, detail="the image border cuts the nose off")
        if not cut:
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
            hypotheses=self._hypotheses(best, _heading(hint, window, span), missing_px2),
        )

    def _hypotheses(
        self, best: _Best, heading: ExpectedHeading | None, missing_px2: FloatArray
    ) -> tuple[PointHypothesis, ...]:
        """Return where the target point may be, in the picture; ``missing_px2`` (2, 2) is added to each covariance."""
        if heading is None or self._config.target_point is TargetPoint.CENTROID:
            return ()
        return tuple(
            PointHypothesis(
                pixel=best.window.to_picture(nose.pixel),
                covariance_px2=nose.covariance_px2 / best.window.scale**2 + missing_px2,
                probability=nose.probability,
            )
            for nose in nose_hypotheses(best.maps, best.candidate, heading)
        )


def _heading(hint: DetectionHint, window: ChannelWindow, span_px: float) -> ExpectedHeading | None:
    """Return the direction of flight in a window, None where it is unknown."""
    if hint.forward_px_per_m is None or not hint.px_per_m or not is_known(hint.forward_sigma_rad):
        return None
    return ExpectedHeading(
        ahead_px=window.scale * span_px / hint.px_per_m * hint.forward_px_per_m,
        span_px=window.scale * span_px,
        sigma_rad=hint.forward_sigma_rad,
    )


def _window_span(span_px: float, hint: DetectionHint) -> float:
    """Return the width that a window shows `TARGET_PX` wide, for a target of ``span_px``.

    A window is as fine as the picture, and no finer, where the target has between `TARGET_PX` and `_FINEST_TARGET_PX`;
    where the direction of flight is unknown, a target has `TARGET_PX`.
    """
    if hint.forward_px_per_m is None or not is_known(hint.forward_sigma_rad):
        return span_px
    return TARGET_PX * max(span_px / _FINEST_TARGET_PX, min(span_px / TARGET_PX, 1.0))


def _step_and_room(span_px: float, window_span_px: float) -> tuple[float, FloatArray]:
    """Return how far windows are apart, and how far (2,) a target may be from the middle of one, px."""
    size = np.array(WINDOW_PX) * window_span_px / TARGET_PX
    return _STEP * float(size[0]), 0.5 * (size - span_px)


def _sides(hint: DetectionHint, span_px: float, window_span_px: float) -> FloatArray:
    """Return how many windows (2,) to each side hold two sigmas of the prediction."""
    step, room = _step_and_room(span_px, window_span_px)
    sigma = np.sqrt(np.diag(hint.predicted_covariance_px2))
    return np.maximum(np.ceil((2.0 * sigma - room) / step), 0.0)


def _holds(hint: DetectionHint, span_px: float, window_span_px: float) -> bool:
    """Return whether as many windows as there may be hold two sigmas of the prediction."""
    return bool(np.all(_sides(hint, span_px, window_span_px) <= (_MOST_WINDOWS - 1) // 2))


def _centres(
    hint: DetectionHint, roi: Box[int], span_px: float, window_span_px: float
) -> Iterator[tuple[FloatArray, float]]:
    """Yield the middles of the windows that hold two sigmas of the prediction, its own first, with their span."""
    step, _ = _step_and_room(span_px, window_span_px)
    sides = np.minimum(_sides(hint, span_px, window_span_px), (_MOST_WINDOWS - 1) // 2).astype(int)
    offsets = [(i, j) for i in range(-sides[0], sides[0] + 1) for j in range(-sides[1], sides[1] + 1)]
    middle = _inside(hint.predicted_px, roi)
    for i, j in sorted(offsets, key=lambda each: abs(each[0]) + abs(each[1])):
        centre = middle + step * np.array([i, j])
        if roi.x0 <= centre[0] < roi.x1 and roi.y0 <= centre[1] < roi.y1:
            yield centre, window_span_px


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
