"""Selection of the target among the segmented regions near its prediction, by size, position, contrast and appearance.

Without a prediction, `candidate_finder` searches the whole frame.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.detection.appearance import Appearance, features_of_regions
from groundstation.detection.config import DetectionConfig
from groundstation.detection.regions import Group, Regions, groups_around
from groundstation.detection.working_image import UNKNOWN_SPAN_PX, WorkingImage
from groundstation.messages import Miss, MissReason

Place = tuple[float, float, float, float, float]  # the predicted u and v, working px, their variances and covariance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetMemory:
    """Model of the target from confident frames: mean width and mass, appearance, and the misses since.

    ``span_px`` is in full-image px, ``mass`` the sum of the contrast in sigmas over the silhouette.
    """

    span_px: float
    mass: float
    appearance: Appearance
    misses: int = 0

    def mass_at(self, span_px: float) -> float:
        """Return the expected mass at a span, in pixels of the same scale as that span."""
        return self.mass * (span_px / self.span_px) ** 2


def select_target(
    regions: Regions, working: WorkingImage, memory: TargetMemory | None, config: DetectionConfig
) -> Group | Miss:
    """Return the group that is the target, or a miss with its reason."""
    (x, y), ((uu, uv), (_, vv)) = working.predicted.tolist(), working.covariance.tolist()
    sigma = math.sqrt(0.5 * (uu + vv) + math.hypot(0.5 * (uu - vv), uv))
    span = working.span if working.span is not None else UNKNOWN_SPAN_PX
    groups = groups_around(
        regions,
        (x, y),
        config.gate_sigmas * sigma + 0.5 * span + 2.0,
        None if working.span is None else working.span * math.exp(min(working.span_sigma, 0.7)),
        0.4 if working.forward is None else 0.35 + 0.35 * float(np.hypot(*working.forward)),
        config.min_contrast_to_noise,
        working.open_edges(),
    )
    if not groups:
        return Miss(reason=MissReason.NO_REGION, detail="no region of enough contrast near the prediction")
    heaviest = max(g.mass for g in groups)

    def unlike(group: Group) -> float:
        return _unlikeness(group, regions, working, memory)

    # mass beyond that of the target does not raise the score: it may be a bird, or a bird merged with the target
    most = math.inf if memory is None or working.span is None else memory.mass_at(span)
    place = (x, y, uu, vv, uv)
    scored = [(_score(g, place, working, min(g.mass, most) / heaviest, unlike, config), g) for g in groups]
    scored.sort(key=lambda s: -s[0])
    best_score, best = scored[0]
    if best.contrast < config.min_contrast_to_noise:
        return Miss(reason=MissReason.LOW_CONTRAST, detail=f"contrast {best.contrast:.1f} sigma")
    if best_score == -math.inf:
        nearest = min(groups, key=lambda g: float(np.hypot(*(g.centre - working.predicted))))
        if _distance(nearest, place) > config.gate_sigmas**2:
            return Miss(reason=MissReason.NO_REGION, detail="the nearest region is too far from the prediction")
        if unlike(nearest) > config.appearance_gate:
            return Miss(reason=MissReason.NO_REGION, detail="the nearest region looks unlike the target")
        return Miss(reason=MissReason.WRONG_SIZE, detail=f"{nearest.width} px wide, {span:.0f} px expected")
    for score, other in scored[1:]:
        as_likely = score - best_score > math.log(config.ambiguity_ratio)
        if as_likely and not (other.belongs & best.belongs).any():
            return Miss(reason=MissReason.AMBIGUOUS, detail="two regions fit the prediction about equally")
    return best


def _unlikeness(group: Group, regions: Regions, working: WorkingImage, memory: TargetMemory | None) -> float:
    """Return the distance of a group's appearance from the target's, in sigmas."""
    if memory is None or group.rim:
        return 0.0
    seen = features_of(group, regions, working)
    return memory.appearance.distance(seen, float(group.width * working.scale), memory.misses)


def _score(
    group: Group,
    place: Place,
    working: WorkingImage,
    share: float,
    unlikeness: Callable[[Group], float],
    config: DetectionConfig,
) -> float:
    """Return the log-likelihood of a group with a ``share`` of the largest mass, −inf if a gate excludes it.

    The appearance is evaluated last, since it is the most expensive.
    """
    distance = _distance(group, place)
    if distance > config.gate_sigmas**2 or group.width * working.scale < config.min_span_px:
        return -math.inf
    score = -0.5 * distance + math.log(share)
    if working.span is not None:
        # one pixel of blur at each wing tip, in addition to the sigma of the hint
        sigma = math.hypot(working.span_sigma, 2.0 / working.span)
        deviation = math.log(group.width / working.span) / sigma
        clipped = group.rim
        if abs(deviation) > config.size_gate_sigmas and not (clipped and deviation < 0):
            return -math.inf
        score -= 0.5 * deviation**2
    unlike = unlikeness(group)
    return -math.inf if unlike > config.appearance_gate else score - 0.5 * unlike**2


def _distance(group: Group, place: Place) -> float:
    """Return the squared distance of a group from the prediction in sigmas; its nose may be off its centre."""
    predicted_x, predicted_y, uu, vv, c = place
    centre_x, centre_y = group.centre.tolist()
    off_centre = 1.0 + (0.15 * group.width) ** 2
    a, b = uu + off_centre, vv + off_centre
    x, y = centre_x - predicted_x, centre_y - predicted_y
    return (b * x * x - 2.0 * c * x * y + a * y * y) / (a * b - c * c)


def features_of(group: Group, regions: Regions, working: WorkingImage) -> FloatArray:
    """Return the appearance features of a group, in full-image px, cached per group."""
    seen = regions.features.get(group)
    if seen is None:
        seen = features_of_regions(working.image, regions.labels, group.members, group.box, group.area)
        regions.features[group] = seen
    return seen
