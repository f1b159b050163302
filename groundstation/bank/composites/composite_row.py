"""The tracker of `groundstation track` on one composite, started on the true box of the first visible frame."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from groundstation.bank.composites.composite_spec import CompositeSpec
from groundstation.bank.composites.draw_composite import draw_composite
from groundstation.bank.composites.render_composite import CompositeFrame, render_composite, silhouette_box
from groundstation.bank.composites.segment_view import CompositeClips
from groundstation.bank.frame_outcomes import HIT_MARGIN_PX
from groundstation.bank.session_truth import distance_outside_px
from groundstation.box import box_of_size
from groundstation.detection.config import DetectorKind
from groundstation.messages import Detection
from groundstation.simulation.world.world_sets import set_of
from groundstation.single_camera.learned_tracker import LearnedPixelTracker
from groundstation.single_camera.make_tracker import make_tracker
from groundstation.single_camera.pixel_tracker import PixelTracker

# borders between the classes of the median width, px
_MEDIUM_PX, _LARGE_PX = 25.0, 60.0
# a composite is of the background, sky or not, of so many of its visible frames
_MOSTLY = 0.9


class FrameVerdict(StrEnum):
    """Rating of the tracker's output for a frame."""

    HIT = "hit"
    WRONG = "wrong"
    MISSED = "missed"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JudgedFrame:
    """A frame, and the tracker's answer to it.

    Attributes
    ----------
    frame : it.
    pixel_px : the reported point; None without one.
    verdict : of a point inside the silhouette or within `HIT_MARGIN_PX` of it, another one, or none.
    """

    frame: CompositeFrame
    pixel_px: tuple[float, float] | None
    verdict: FrameVerdict


def track_composite(
    frames: Iterable[CompositeFrame], detector: DetectorKind = DetectorKind.LEARNED
) -> Iterable[JudgedFrame]:
    """Yield the judged frames of a composite from its first visible one on."""
    tracker: PixelTracker | LearnedPixelTracker | None = None
    for frame in frames:
        if tracker is None:
            if not frame.visible or frame.silhouette is None:
                continue
            tracker = make_tracker(detector, (frame.image.shape[1], frame.image.shape[0]))
            own = silhouette_box(frame.silhouette)
            track = tracker.start(
                frame.image, frame.t_s, box_of_size(float(own.x0), float(own.y0), *map(float, own.size))
            )
        else:
            track = tracker.step(frame.image, frame.t_s)
        found = track.result
        pixel = (found.u_px, found.v_px) if isinstance(found, Detection) else None
        yield JudgedFrame(frame=frame, pixel_px=pixel, verdict=_verdict(frame, pixel))


def composite_row(seed: int, clips: CompositeClips) -> dict[str, Any]:
    """Draw, render and track the composite of a seed; return its figures by name.

    Raises `ScenarioError` as `draw_composite` does.
    """
    spec = draw_composite(seed, clips)
    footage = clips.footage(set_of(seed), spec.clip, spec.first)
    return row_of(spec, track_composite(render_composite(spec, footage)))


def row_of(spec: CompositeSpec, judged: Iterable[JudgedFrame]) -> dict[str, Any]:
    """Return the figures of a composite with rated frames."""
    visible = [each for each in judged if each.frame.visible]
    count = len(visible)
    hits, wrong = (sum(each.verdict is kind for each in visible) for kind in (FrameVerdict.HIT, FrameVerdict.WRONG))
    width = float(np.median([each.frame.width_px for each in visible])) if visible else 0.0
    sky = float(np.mean([each.frame.over_sky for each in visible])) if visible else 0.0
    size = "small" if width < _MEDIUM_PX else "medium" if width < _LARGE_PX else "large"
    background = "sky" if sky >= _MOSTLY else "ground" if sky <= 1.0 - _MOSTLY else "both"
    return {
        "seed": spec.seed,
        "clip": spec.clip,
        "first": spec.first,
        "last": spec.last,
        "family": str(spec.airframe.family),
        "birds": len(spec.birds),
        "width_px": width,
        "size": size if visible else "none",
        "background": background if visible else "none",
        "snr": float(np.median([each.frame.snr for each in visible])) if visible else 0.0,
        "frames": spec.last - spec.first + 1,
        "visible_frames": count,
        "hit": hits,
        "wrong": wrong,
        "hit_share": hits / count if count else None,
        "wrong_share": wrong / count if count else None,
    }


def _verdict(frame: CompositeFrame, pixel: tuple[float, float] | None) -> FrameVerdict:
    if pixel is None:
        return FrameVerdict.MISSED
    if frame.silhouette is None:
        return FrameVerdict.WRONG
    near = distance_outside_px(frame.silhouette, np.array(pixel)) <= HIT_MARGIN_PX
    return FrameVerdict.HIT if near else FrameVerdict.WRONG
