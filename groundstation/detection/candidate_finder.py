"""Candidates for the aircraft in one whole frame, without a prediction; one finder per camera.

It combines the regions of high contrast (`spot_detection`) with the regions that move (`background_motion`) into a
short list, best first. Two cameras choose the target among them by initiation (`estimation`), one camera alone by
`target_confirmation`. `window_search` applies the finder to a part of the frame, and `target_selection` chooses among
the segmented regions where a prediction exists.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray, MaskArray
from groundstation.box import Box
from groundstation.detection.background_motion import BackgroundChange, SceneModel
from groundstation.detection.skyline import CELL_PX, sky_around, sky_cells
from groundstation.detection.spot_detection import CandidateRegion, contrast_map, find_spots, gap, joined, scales
from groundstation.geometry.camera import Lens
from groundstation.picture import Picture, as_picture

_MIN_FRAME_PX = 16
_NEAR_PX = 5.0  # working px: moving fragments closer than this are one
_LEFT_BEHIND = 0.4  # structure now, as a share of the structure before
_REACH_PX, _MAX_MATCHED_PX, _MATCH = 24, 64, 0.6  # working px, and the correlation asked for
_GROWTH, _MOTION_GROWTH = 2.0, 4.0  # how much fragments may enlarge the main piece
_TOUCHING = 0.05  # gap between pieces that touch, as a share of the larger one's size
_WHOLE = 1.5  # so much larger than its part is a whole
_PART = 0.15  # mass of a fragment that may be a separate object, as a share of the whole
_CLEAR = 0.7  # share of sky around something whose silhouette is all its own


@dataclass(frozen=True, slots=True, kw_only=True)
class AcquisitionConfig:
    """Tuning of the whole-frame search.

    Attributes
    ----------
    working_width_px : images wider than this are searched in a reduced copy.
    levels, reduction : number of scales, and the reduction from each to the next.
    low_sigma, high_sigma : a spot is a region beyond the first that somewhere exceeds the second.
    motion_low_sigma, motion_high_sigma : the same for the difference from the static scene.
    memory_s, spacing_s : age and spacing of the frames that are kept to detect motion.
    alignment_px : largest misplacement of the scene from its position by the angles, in full-image px.
    join_reach, motion_join_reach : fragments closer than this share of the larger one's size are one candidate;
        the second for regions found by motion.
    ground_weight : weight of the score of a static region that is not surrounded by sky.
    max_candidates : at most this many are returned.
    max_size : the largest candidate, as a share of the frame's width.
    max_elongation : longer and thinner regions are lines, not aircraft.
    """

    working_width_px: int = 640
    levels: int = 2
    reduction: int = 4
    low_sigma: float = 3.0
    high_sigma: float = 4.5
    motion_low_sigma: float = 2.3
    motion_high_sigma: float = 3.5
    memory_s: float = 2.5
    spacing_s: float = 0.2
    alignment_px: float = 12.0
    join_reach: float = 0.35
    motion_join_reach: float = 1.0
    ground_weight: float = 0.1
    max_candidates: int = 12
    max_size: float = 0.6
    max_elongation: float = 12.0

    def __post_init__(self) -> None:
        if self.working_width_px < 64 or self.levels < 1 or self.reduction < 2 or self.max_candidates < 1:
            raise ValueError("working_width_px must be ≥ 64, levels and max_candidates ≥ 1, reduction ≥ 2")
        if not 0 < self.low_sigma <= self.high_sigma or not 0 < self.motion_low_sigma <= self.motion_high_sigma:
            raise ValueError(
                "low_sigma and motion_low_sigma must be > 0 and not above high_sigma and motion_high_sigma"
            )
        if self.memory_s <= 0 or self.spacing_s < 0 or self.alignment_px <= 0:
            raise ValueError("memory_s and alignment_px must be > 0, spacing_s ≥ 0")
        if not 0 < self.max_size <= 1 or self.max_elongation < 1 or not 0 <= self.ground_weight <= 1:
            raise ValueError("max_size and ground_weight must be in (0, 1] and [0, 1], max_elongation ≥ 1")
        if min(self.join_reach, self.motion_join_reach) < 0:
            raise ValueError("join_reach and motion_join_reach must be ≥ 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Something in one frame that might be the aircraft.

    Attributes
    ----------
    u_px, v_px : its centre in full-image pixels.
    box : in full-image pixels, counted from the edge of pixel 0.
    score : about its contrast-to-noise; comparable between the candidates of one frame.
    moving : whether it moves significantly against the static background.
    motion_px_s : (u, v) rate relative to the background, None where not measured.
    sigma_px : one sigma of u and v as estimated for this candidate, None where it is not.
    odds : log odds of aircraft, as the learned channel weighs the candidate; None without it.
    """

    u_px: float
    v_px: float
    box: Box[float]
    score: float
    moving: bool
    motion_px_s: tuple[float, float] | None
    sigma_px: float | None = None
    odds: float | None = None


class CandidateFinder:
    """Finds candidates in the frames of one camera; keeps small copies of the last ones to see motion.

    Parameters
    ----------
    image_size_px : (w, h) of the images.
    lens : the calibrated lens, None for a camera of which nothing is known.
    """

    def __init__(self, config: AcquisitionConfig, image_size_px: tuple[int, int], lens: Lens | None = None) -> None:
        self._config = config
        self._image_size = image_size_px
        factor = max(1.0, image_size_px[0] / config.working_width_px)
        self._size = (
            max(round(image_size_px[0] / factor), _MIN_FRAME_PX),
            max(round(image_size_px[1] / factor), _MIN_FRAME_PX),
        )
        self._scale = image_size_px[0] / self._size[0]
        self._lens = lens
        self._memory = SceneModel(
            self._size,
            self._scale,
            lens,
            memory_s=config.memory_s,
            spacing_s=config.spacing_s,
            limit_px=config.alignment_px / self._scale,
        )

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._memory.reset()

    def find(
        self,
        image: ImageArray | Picture,
        t_s: float,
        camera_from_runway: FloatArray | None = None,
        places: Sequence[tuple[FloatArray, float]] = (),
    ) -> tuple[Candidate, ...]:
        """Return the candidates of one frame, best first.

        Parameters
        ----------
        image : a picture, or (h, w, 3) BGR.
        t_s : its mid-exposure; a frame that is not newer than the last one starts afresh.
        camera_from_runway : (3, 3) rotation at that time, None where it is not known.
        places : points (2,) with the width to expect there, px, that the learned channel looks at as well; contrasts
            are found all over the picture.
        """
        grey = cv2.cvtColor(as_picture(image).whole(), cv2.COLOR_BGR2GRAY)
        if (grey.shape[1], grey.shape[0]) != self._size:
            grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
        working = np.asarray(grey, np.uint8)
        still = self._standing_out(working, camera_from_runway)
        change = self._memory.change(working, t_s, camera_from_runway)
        return self._combined(still, working, change)

    # ------------------------------------------------------------------------------------- in one image
    def _standing_out(self, grey: ImageArray, camera_from_runway: FloatArray | None) -> list[CandidateRegion]:
        """Return what stands out by contrast, weighted by where it is."""
        c = self._config
        spots: list[CandidateRegion] = []
        sky: MaskArray | None = None
        for level in scales(grey, c.levels, c.reduction):
            contrast = contrast_map(level)
            if sky is None:
                sky = sky_cells(grey, contrast.spread, self._up(camera_from_runway))
            spots += find_spots(contrast.sigmas, c.low_sigma, c.high_sigma, self._image_size[0] / level.shape[1])
        if sky is None:
            return []
        weighted = [self._weighted(s, sky) for s in spots if self._plausible(s)]
        single = _distinct(sorted(weighted, key=lambda s: -s.contrast))
        # a large aircraft consists of pieces that touch, but so does a small one before a cloud: both are returned
        hanging = [s for s in weighted if s.sky >= _CLEAR]
        whole = [w for w in joined(hanging, _TOUCHING, 0.0, _GROWTH) if w not in hanging]
        return sorted(whole + single, key=lambda s: -s.contrast)

    def _up(self, camera_from_runway: FloatArray | None) -> FloatArray | None:
        """Return (3,) whose product with a working pixel (x, y, 1) is positive above the horizon."""
        if camera_from_runway is None or self._lens is None:
            return None
        (fx, fy), (cx, cy) = self._lens.focal_px, self._lens.principal_point_px
        full_from_working = np.array(
            [
                [self._scale, 0.0, 0.5 * (self._scale - 1.0)],
                [0.0, self._scale, 0.5 * (self._scale - 1.0)],
                [0.0, 0.0, 1.0],
            ]
        )
        ray_from_full = np.array([[1 / fx, 0.0, -cx / fx], [0.0, 1 / fy, -cy / fy], [0.0, 0.0, 1.0]])
        return np.asarray(camera_from_runway[:, 2] @ ray_from_full @ full_from_working, np.float64)

    def _plausible(self, spot: CandidateRegion) -> bool:
        w, h = spot.box.size
        if max(w, h) > self._config.max_size * self._image_size[0]:
            return False
        return max(w, h) <= self._config.max_elongation * min(w, h)

    def _weighted(self, spot: CandidateRegion, sky: MaskArray) -> CandidateRegion:
        """Return the spot with its contrast reduced by how little of its surroundings is sky."""
        cell = CELL_PX * self._scale
        x0, y0, x1, y1 = (v / cell for v in spot.box)
        share = float(sky_around(sky, x0, y0, x1, y1))
        least = self._config.ground_weight
        return replace(spot, contrast=spot.contrast * (least + (1.0 - least) * share), sky=share)

    # ----------------------------------------------------------------------------------- against others
    def _changed(self, grey: ImageArray, change: BackgroundChange) -> list[CandidateRegion]:
        """Return what moves against the static scene."""
        c = self._config
        spots = find_spots(change.significance, c.motion_low_sigma, c.motion_high_sigma, self._scale)
        pieces = [s for s in spots if self._plausible(s)]
        near = _NEAR_PX * self._scale
        # for an object that hardly moves only the edges show, far apart; two objects that pass close to each other
        # have the same appearance: the whole, its main piece, and the remainder are returned
        whole = joined(joined(pieces, c.join_reach, near, _GROWTH), c.motion_join_reach, near, _MOTION_GROWTH)
        for w in list(whole):
            parts = [p for p in pieces if p != w and _inside(p, w)]
            if len(parts) > 1:
                main = max(parts, key=lambda p: p.mass)
                rest = joined([p for p in parts if p != main], c.motion_join_reach, near, _MOTION_GROWTH)
                whole += [p for p in (main, *rest) if p.mass >= _PART * w.mass]
        return [s for s in whole if self._plausible(s) and not self._left_behind(s, grey, change.earlier)]

    def _left_behind(self, spot: CandidateRegion, grey: ImageArray, earlier: ImageArray) -> bool:
        """Return whether something was here earlier and is no more."""
        window = self._window(spot, 2).slices
        now, then = grey[window], earlier[window]
        return float(now.std()) < _LEFT_BEHIND * float(then[then > 0].std() if (then > 0).any() else 0.0)

    def _motion(self, spot: CandidateRegion, grey: ImageArray, change: BackgroundChange) -> tuple[float, float] | None:
        """Return the rate (u, v) in px/s at which a spot moves over the scene, None where it is not found again."""
        x0, y0, x1, y1 = self._window(spot, 2)
        if x1 - x0 > _MAX_MATCHED_PX or y1 - y0 > _MAX_MATCHED_PX or change.age_s <= 0.0:
            return None
        a, b = max(x0 - _REACH_PX, 0), max(y0 - _REACH_PX, 0)
        c, d = min(x1 + _REACH_PX, grey.shape[1]), min(y1 + _REACH_PX, grey.shape[0])
        answer = cv2.matchTemplate(change.earlier[b:d, a:c], grey[y0:y1, x0:x1], cv2.TM_CCOEFF_NORMED)
        _, best, _, (column, row) = cv2.minMaxLoc(answer)
        if best < _MATCH:
            return None
        rate = self._scale / change.age_s
        return (x0 - a - column) * rate, (y0 - b - row) * rate

    def _window(self, spot: CandidateRegion, margin: int) -> Box[int]:
        """Return the spot's box in working pixels, widened and inside the picture."""
        x0, y0, x1, y1 = (round(v / self._scale) for v in spot.box)
        w, h = self._size
        return Box(max(x0 - margin, 0), max(y0 - margin, 0), min(x1 + margin, w), min(y1 + margin, h))

    def _combined(
        self, still: list[CandidateRegion], grey: ImageArray, change: BackgroundChange | None
    ) -> tuple[Candidate, ...]:
        """Return all as candidates, best first; regions found both ways count once.

        Against the sky the contrast shows the whole silhouette, against the ground only the motion is its own.
        """
        found: list[Candidate] = []
        rest = list(still)
        for m in [] if change is None else self._changed(grey, change)[: self._config.max_candidates]:
            same = [s for s in rest if gap(s, m) <= 0.0]
            clear = [s for s in same if s.sky >= _CLEAR and s.size <= 4.0 * m.size]
            rest = [s for s in rest if s not in clear and (s.sky >= _CLEAR or not _inside(s, m))]
            best = m
            if clear:
                whole = joined(clear, self._config.join_reach, 0.0, _GROWTH)[0]
                best = replace(whole, contrast=max(whole.contrast, m.contrast))
            rate = None if change is None else self._motion(best, grey, change)
            found.append(self._candidate(best, moving=True, motion_px_s=rate))
        found += [self._candidate(s, moving=False, motion_px_s=None) for s in rest[: self._config.max_candidates]]
        found.sort(key=lambda f: -f.score)
        return tuple(found[: self._config.max_candidates])

    def _candidate(self, spot: CandidateRegion, *, moving: bool, motion_px_s: tuple[float, float] | None) -> Candidate:
        w, h = self._image_size
        x0, y0, x1, y1 = spot.box
        return Candidate(
            u_px=min(max(spot.centre[0], 0.0), w - 1.0),
            v_px=min(max(spot.centre[1], 0.0), h - 1.0),
            box=Box(max(x0, 0.0), max(y0, 0.0), min(x1, float(w)), min(y1, float(h))),
            score=spot.contrast,
            moving=moving,
            motion_px_s=motion_px_s,
        )


def _inside(a: CandidateRegion, b: CandidateRegion) -> bool:
    """Return whether the centre of ``a`` is in the box of ``b``."""
    return b.box.x0 <= a.centre[0] <= b.box.x1 and b.box.y0 <= a.centre[1] <= b.box.y1


def _distinct(spots: list[CandidateRegion]) -> list[CandidateRegion]:
    """Drop every spot whose centre is in a better one's box, unless it is the whole of which that is a part."""
    kept: list[CandidateRegion] = []
    for s in spots:
        if not any(_inside(s, k) and s.size <= _WHOLE * k.size for k in kept):
            kept.append(s)
    return kept
