"""Candidates of a whole frame, confirmed by the learned channel.

The classic finder proposes what stands out or moves; a window around each proposal says how likely it is an aircraft,
where its nose is and how wide it is. A proposal that the network does not know keeps a small share of its score: what
was not in its training can still start a track, but not against something that is known.
"""

import math
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder
from groundstation.detection.channel_window import TARGET_PX, channel_window
from groundstation.detection.config import DetectionConfig
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.detection.learned_detector import ChannelCandidate, candidates_of, nose_in
from groundstation.files.channel_weights import channel_weights
from groundstation.geometry.camera import Lens
from groundstation.picture import Picture, as_picture

# of its score that a proposal keeps at least
_LEAST_SHARE = 0.05
# a proposal may be of a part of the aircraft only, or of more than it: regions so near to its centre, in targets, count
_REACH = 1.0


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
        self._proposals = CandidateFinder(acquisition, image_size_px, lens)
        self._channel = LearnedChannel(channel_weights(detection.weights_sha256))
        self._detection = detection

    def reset(self) -> None:
        """Discard the earlier frames."""
        self._proposals.reset()

    def find(
        self, image: ImageArray | Picture, t_s: float, camera_from_runway: FloatArray | None = None
    ) -> tuple[Candidate, ...]:
        """Return the candidates of one frame, best first; arguments as of `CandidateFinder.find`."""
        picture = as_picture(image)
        found = [self._weighed(picture, c) for c in self._proposals.find(picture, t_s, camera_from_runway)]
        return tuple(sorted(found, key=lambda c: -c.score))

    def _weighed(self, picture: Picture, proposal: Candidate) -> Candidate:
        """Return a proposal with its score weighed, and at the nose where the channel shows one."""
        centre = np.array([proposal.u_px, proposal.v_px])
        span = max(proposal.box.w, self._detection.min_span_px)
        window = channel_window(picture, centre, span)
        if window is None:
            return proposal
        maps = self._channel.maps(window.image)
        middle = window.from_picture(centre)
        near = [
            c
            for c in candidates_of(maps, self._detection.level_set.mu)
            if float(np.hypot(*(c.centre - middle))) <= _REACH * TARGET_PX
            and _is_inside(window.to_picture(c.centre), picture.size_px)
        ]
        if not near:
            return replace(proposal, score=_LEAST_SHARE * proposal.score)
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
        return replace(proposal, u_px=u, v_px=v, box=box, score=score, sigma_px=sigma)


def _is_inside(point_px: FloatArray, size_px: tuple[int, int]) -> bool:
    """Return whether a point (2,) is in the picture: beyond its border a window repeats it, and may show a copy."""
    return bool(np.all(point_px > -0.5) and np.all(point_px < np.array(size_px) - 0.5))
