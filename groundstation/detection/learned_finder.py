"""Candidates of a whole frame, confirmed by the learned channel.

A window of the learned channel says how likely something in it is an aircraft, where its nose is and how wide it is. A
frame has room for some hundred windows, and time for a few. They go, in this order, to where the channel has seen an
aircraft in the frame before; to the proposals of the classic finder that stand out most; to some of its others, in
turns; to what the proposal network gives of a part or two of the frame, in turns; to places where what other cameras
show may be; and to a grid over the frame, at several target sizes, from the middle outwards, in turns as well, which
need not look like what the proposal network was trained on.

A proposal that the channel does not know keeps a small share of its score: what was not in its training can still start
a track, but not against something that is known.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder
from groundstation.detection.channel_candidate import ChannelCandidate, candidates_of
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, channel_window
from groundstation.detection.config import DetectionConfig
from groundstation.detection.kept_place import (
    FALL,
    RESCALED,
    KeptPlace,
    Look,
    kept_places,
    likeliest_places,
    middle_of,
    odds_of,
)
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.detection.nose_hypotheses import nose_in
from groundstation.detection.proposal_finder import ProposalFinder
from groundstation.files.channel_weights import channel_weights, proposal_weights
from groundstation.geometry.camera import Lens
from groundstation.picture import Picture, as_picture

# of its score that a proposal keeps at least
_LEAST_SHARE = 0.05
# a proposal may be of a part of the aircraft only, or of more than it: regions so near to its centre, in targets, count
_REACH = 1.0
# windows of a frame: where an aircraft was, the first proposals, others in turns, the grid in turns. On twenty train
# worlds the first 12 proposals had 80 % of the aircraft in them and the first 24 86 %, the channel knows 93 % of them
_FIRST, _OTHERS, _GRID = 4, 1, 4
# of the proposal network: its parts of a frame are gone through in this time, but at most so many of one frame; of each
# so many proposals are looked at
_WHOLE_S, _PARTS, _OF_PART = 0.25, 2, 3
_PROPOSALS = 24
# neighbouring windows of the grid overlap so far that a place is within a target of the middle of one
_STEP = 0.54
# target widths of the grid, px, up to this share of the frame's width
_GRID_SPANS_PX = tuple(TARGET_PX * 2.0**k for k in range(6))
_WIDEST = 0.5
# where the window has become narrower by more within a few frames, the wider one is looked into as well
_SHRUNK = 1.25
# widths at which something of a known size is looked at, as shares of it: what outlines show may be a part or a rim
_WIDTHS = (1.0, 1.5, 0.7)
# a region that is narrower by more is a part of it, such as a letter on a sign
_ALIKE = 2.0
# a window of the grid whose levels vary less, one sigma, is an even sky: an aircraft there stands out, and is proposed
_FLAT = 1.0
# candidates nearer to each other than this share of their width are one, unless one is so much wider: a window that is
# too narrow for an aircraft shows its fuselage, and another camera may show all of it
_SAME, _WIDER = 0.3, 1.6


class LearnedFinder:
    """Finds candidates in the frames of one camera.

    Parameters
    ----------
    image_size_px : (w, h) of the images.
    lens : the calibrated lens, None for a camera of which nothing is known.
    """

    def __init__(
        self,
        acquisition: AcquisitionConfig,
        detection: DetectionConfig,
        image_size_px: tuple[int, int],
        lens: Lens | None = None,
    ) -> None:
        proposals = replace(acquisition, max_candidates=max(_PROPOSALS, acquisition.max_candidates))
        self._proposals = CandidateFinder(proposals, image_size_px, lens)
        self._channel = LearnedChannel(channel_weights(detection.weights_sha256))
        self._detection, self._most = detection, acquisition.max_candidates
        self._lens = lens
        self._grid = grid_of(image_size_px)
        self._proposer = ProposalFinder(proposal_weights(), image_size_px)
        self._next = self._next_other = self._next_part = 0
        self._last_s = -math.inf
        self._kept: list[KeptPlace] = []
        self._is_wider = False
        self._camera_from_runway: FloatArray | None = None

    def reset(self) -> None:
        """Discard the earlier frames."""
        self._proposals.reset()
        # turns go on: a false target every few seconds must not keep them in the middle
        self._last_s = -math.inf
        self._kept, self._camera_from_runway = [], None

    def find(
        self,
        image: ImageArray | Picture,
        t_s: float,
        camera_from_runway: FloatArray | None = None,
        places: Sequence[tuple[FloatArray, float]] = (),
    ) -> tuple[Candidate, ...]:
        """Return the candidates of one frame, best first; arguments as of `CandidateFinder.find`."""
        picture = as_picture(image)
        proposals = self._proposals.find(picture, t_s, camera_from_runway)
        brightest = max((p.score for p in proposals), default=1.0)
        kept = [
            replace(k, centre_px=place)
            for k, place in zip(self._kept, self.places_kept(camera_from_runway), strict=True)
        ]
        again = [self._seen_again(picture, k, brightest) for k in kept]
        seen = [c for _, c in again if c is not None]
        chosen, others = self._chosen(proposals)
        weighed = [self._weighed(picture, p) for p in chosen]
        proposed = self._proposed(picture, t_s, [c for c in seen if odds_of(c) > 0.0])
        for look in proposed:
            seen += self._seen_at(picture, look, brightest)
        guided = [Look(centre_px=centre, span_px=width) for centre, width in places]
        left = max(_GRID - len(guided) - len(proposed), 1 if proposed else 2)
        for look in (*guided, *self._turn_of_grid(left)):
            seen += self._seen_at(picture, look, brightest, _FLAT)
        unknown = [replace(p, score=_LEAST_SHARE * p.score) for p in others]
        found = distinct([*weighed, *seen, *unknown])
        self._kept = kept_places(likeliest_places([c for c in found if odds_of(c) > 0.0]), [k for k, _ in again])
        self._camera_from_runway = camera_from_runway
        return tuple(sorted(found, key=lambda c: -c.score)[: self._most])

    def aircraft_odds(self, image: ImageArray | Picture, box: Box[float]) -> float:
        """Return the log odds of an aircraft that is about as wide as a box of a frame; minus infinity without one."""
        picture, length = as_picture(image), max(box.w, box.h)
        looks = (Look(centre_px=middle_of(box), span_px=share * length) for share in _WIDTHS)
        seen = [c for look in looks for c in self._seen_at(picture, look, 1.0)]
        return max((odds_of(c) for c in seen if length <= _ALIKE * max(c.box.w, c.box.h)), default=-math.inf)

    # --------------------------------------------------------------------------------------- where to look
    def places_kept(self, camera_from_runway: FloatArray | None = None) -> list[FloatArray]:
        """Return where (2,) the last frame's aircraft are in a frame, as the camera has turned in between."""
        return [self._turned(k.centre_px, camera_from_runway) for k in self._kept]

    def _turned(self, pixel: FloatArray, camera_from_runway: FloatArray | None) -> FloatArray:
        """Return where a pixel (2,) of the last frame is in this one, without its lens' distortion."""
        if self._lens is None or camera_from_runway is None or self._camera_from_runway is None:
            return pixel
        focal, middle = self._lens.focal_px, self._lens.principal_point_px
        ray = camera_from_runway @ self._camera_from_runway.T @ np.append((pixel - middle) / focal, 1.0)
        return np.asarray(middle + focal * ray[:2] / ray[2]) if ray[2] > 0.0 else pixel

    def _chosen(self, proposals: tuple[Candidate, ...]) -> tuple[list[Candidate], list[Candidate]]:
        """Return the proposals that this frame has time for, the first ones and some others in turns, and the rest."""
        first, others = list(proposals[:_FIRST]), list(proposals[_FIRST:])
        count = min(_OTHERS, len(others))
        start = self._next_other % max(len(others), 1)
        self._next_other += count
        others = [*others[start:], *others[:start]]
        return [*first, *others[:count]], others[count:]

    def _proposed(self, picture: Picture, t_s: float, seen: Sequence[Candidate]) -> list[Look]:
        """Return what the proposal network gives of the next part of a frame, but what has been ``seen`` there."""
        count, elapsed_s = self._proposer.count, t_s - self._last_s
        due = math.ceil(count * elapsed_s / _WHOLE_S) if 0.0 < elapsed_s < _WHOLE_S else count
        parts = range(self._next_part, self._next_part + min(due, _PARTS, count))
        self._next_part, self._last_s = parts.stop % count, t_s
        proposals = self._proposer.proposals(picture.whole(), parts, _OF_PART * len(parts))
        return [
            Look(centre_px=p.centre_px, span_px=p.width_px)
            for p in proposals
            if not any(
                math.dist(p.centre_px, middle_of(c.box)) <= _SAME * p.width_px
                and max(p.width_px, c.box.w) <= _WIDER * min(p.width_px, c.box.w)
                for c in seen
            )
        ]

    def _turn_of_grid(self, count: int) -> Iterator[Look]:
        """Yield the next places of the grid."""
        for _ in range(min(count, len(self._grid))):
            yield self._grid[self._next % len(self._grid)]
            self._next += 1

    # ------------------------------------------------------------------------------------- what is there
    def _seen_at(self, picture: Picture, look: Look, brightest: float, flat: float = 0.0) -> list[Candidate]:
        """Return the likeliest aircraft in a window, if there is one.

        ``brightest`` is the proposals' best score; a window whose levels vary by less than ``flat`` is left out.
        """
        span = max(look.span_px, self._detection.min_span_px)
        whole = Box(0.0, 0.0, *(float(n) for n in picture.size_px))
        at = replace(_NOTHING, u_px=float(look.centre_px[0]), v_px=float(look.centre_px[1]), score=brightest, box=whole)
        found = self._in_window(picture, look.centre_px, span, at, flat)
        return [] if found is None or odds_of(found) <= 0.0 else [found]

    def _seen_again(self, picture: Picture, kept: KeptPlace, brightest: float) -> tuple[KeptPlace, Candidate | None]:
        """Return the aircraft of the last frame in this one, and the width of the window that shows it best."""
        found = next(iter(self._seen_at(picture, kept.look, brightest)), None)
        widest = max(kept.recent_px, default=0.0)
        if widest > _SHRUNK * kept.span_px:
            # what hid the wings may have passed
            whole = replace(kept, span_px=widest)
            seen = next(iter(self._seen_at(picture, whole.look, brightest)), None)
            if seen is not None and (found is None or odds_of(seen) >= odds_of(found)):
                return whole, seen
        if found is not None and odds_of(found) >= kept.odds - FALL:
            return kept, found
        self._is_wider = not self._is_wider
        other = replace(kept, span_px=kept.span_px * (RESCALED if self._is_wider else 1.0 / RESCALED))
        better = next(iter(self._seen_at(picture, other.look, brightest)), None)
        if better is None or (found is not None and odds_of(found) >= odds_of(better)):
            return kept, found
        return other, better

    def _weighed(self, picture: Picture, proposal: Candidate) -> Candidate:
        """Return a proposal with its score weighed, and at the nose where the channel shows one."""
        centre = np.array([proposal.u_px, proposal.v_px])
        found = self._in_window(picture, centre, max(proposal.box.w, self._detection.min_span_px), proposal)
        return proposal if found is None else found

    def _in_window(
        self, picture: Picture, centre: FloatArray, span: float, proposal: Candidate, flat: float = 0.0
    ) -> Candidate | None:
        """Return a proposal as the window around ``centre`` (2,) shows it; None where there is none, or a flat one."""
        window = channel_window(picture, centre, span)
        if window is None or (flat > 0.0 and _spread(window.image) < flat):
            return None
        unknown = replace(proposal, score=_LEAST_SHARE * proposal.score, odds=-math.inf)
        maps = self._channel.maps_with_aircraft(window.image)
        if maps is None:
            return unknown
        middle = window.from_picture(centre)
        near = [
            c
            for c in candidates_of(maps, self._detection.level_set.mu)
            if float(np.hypot(*(c.centre - middle))) <= _REACH * TARGET_PX
            and _is_inside(window.to_picture(c.centre), picture.size_px)
        ]
        if not near:
            return unknown
        best: ChannelCandidate = max(near, key=lambda c: c.odds)
        probability = 1.0 / (1.0 + math.exp(-best.odds))
        score = max(probability, _LEAST_SHARE) * proposal.score
        w, h = picture.size_px
        nose, covariance = nose_in(maps, best)
        sigma = math.sqrt(0.5 * float(np.trace(covariance))) / window.scale if best.odds > 0.0 else None
        u, v = (min(max(float(x), 0.0), n - 1.0) for x, n in zip(window.to_picture(nose), (w, h), strict=True))
        # a candidate's box counts from the edge of pixel 0
        x0, y0 = window.to_picture(np.array([best.box.x0, best.box.y0]) - 0.5) + 0.5
        x1, y1 = window.to_picture(np.array([best.box.x1, best.box.y1]) - 0.5) + 0.5
        box = Box(max(float(x0), 0.0), max(float(y0), 0.0), min(float(x1), float(w)), min(float(y1), float(h)))
        return replace(proposal, u_px=u, v_px=v, box=box, score=score, sigma_px=sigma, odds=best.odds)


_NOTHING = Candidate(u_px=0.0, v_px=0.0, box=Box(0.0, 0.0, 0.0, 0.0), score=0.0, moving=False, motion_px_s=None)


def grid_of(image_size_px: tuple[int, int]) -> list[Look]:
    """Return places all over a frame (w, h), for targets of several widths, from the middle outwards."""
    size = np.array(image_size_px, np.float64)
    looks = []
    for span in _GRID_SPANS_PX:
        if span > TARGET_PX and span > _WIDEST * size[0]:
            break
        step = _STEP * np.array(WINDOW_PX) * span / TARGET_PX
        counts = np.maximum(np.ceil(size / step), 1).astype(int)
        columns, rows = ((np.arange(n) + 0.5) * length / n for n, length in zip(counts, size, strict=True))
        looks += [Look(centre_px=np.array([u, v]) - 0.5, span_px=span) for v in rows for u in columns]
    return sorted(looks, key=lambda look: float(np.hypot(*((look.centre_px - 0.5 * size) / size))))


def _spread(image: ImageArray) -> float:
    """Return one sigma of a window's levels."""
    return float(cv2.meanStdDev(image)[1].max())


def distinct(found: list[Candidate]) -> list[Candidate]:
    """Return candidates without those that are the same aircraft, of about the same width, as a likelier one."""
    chosen: list[Candidate] = []
    for c in sorted(found, key=odds_of, reverse=True):
        if odds_of(c) <= 0.0 or not any(_is_same(c, d) for d in chosen):
            chosen.append(c)
    return chosen


def _is_same(c: Candidate, likelier: Candidate) -> bool:
    """Return whether a candidate is at the place of a likelier one and about as wide."""
    near = math.hypot(c.u_px - likelier.u_px, c.v_px - likelier.v_px) <= _SAME * c.box.w
    return near and max(c.box.w, likelier.box.w) <= _WIDER * min(c.box.w, likelier.box.w)


def _is_inside(point_px: FloatArray, size_px: tuple[int, int]) -> bool:
    """Return whether a point (2,) is in the picture: beyond its border a window repeats it, and may show a copy."""
    return bool(np.all(point_px > -0.5) and np.all(point_px < np.array(size_px) - 0.5))
