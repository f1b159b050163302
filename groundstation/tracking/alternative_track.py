"""The second hypothesis on the target: what cameras agree on among themselves while the filter rejects it.

After a time with one camera, or with wrong pixels, the filter may be so far off that its gate rejects every correct
pixel. The pixels of an epoch in which no two were accepted are therefore linked as those of a search are
(`TrackInitiator`), and the target is restarted where they are confirmed. Until then the hypothesis is carried along.

With three cameras and more the pixels of most of them outweigh what the filter accepts: one wrong pixel that was
accepted while the range was uncertain must not have it reject all others. The largest set of cameras whose rays meet is
linked where it has a rejected pixel and more cameras than were accepted.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.initialise import TrackInitiator
from groundstation.estimation.triangulation import triangulate
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Kinematics
from groundstation.tracking.epoch_buffer import EpochView, EpochViews

# looks on which the cameras must agree
_LOOKS = 3
# chance agreements of pixels of two detectors: they must move on for so long, as a target found by searching does
_LEAST_AGE_S = 0.2
# cameras are a majority from three on: any two horizontal rays meet somewhere. Their rays miss each other by more with
# this probability; of many cameras at most so many are left out
_MAJORITY, _TAIL, _MOST_OUT = 3, 1e-3, 2


class AlternativeTrack:
    """Links pixels that the filter rejects, of two cameras and more.

    Parameters
    ----------
    stations : geometry of every station by name.
    config : of track initiation; three looks are sufficient here, as the aircraft is known to be there.
    """

    def __init__(self, stations: Mapping[str, StationGeometry], config: InitiationConfig, span_m: float | None) -> None:
        chosen = replace(config, hits=_LOOKS, min_age_s=_LEAST_AGE_S, max_misses=_LOOKS)
        labelled = replace(chosen, min_age_s=0.0)
        self._by_detector = TrackInitiator(stations, chosen, span_m)
        self._labelled = TrackInitiator(stations, labelled, span_m)

    def reset(self) -> None:
        """Discard the hypothesis."""
        self._by_detector.reset()
        self._labelled.reset()

    def step(self, t_s: float, views: EpochViews, *, known_lately: bool) -> Kinematics | None:
        """Process the pixels of one epoch; return the target at ``t_s`` once they are confirmed against the filter.

        ``known_lately``: two cameras have confirmed the filter's position within the last moments. A
        pixel that the filter accepts then outweighs one that it rejects: with a horizontal baseline the ray of a wrong
        pixel at the target's height meets the right one somewhere.
        """
        trusted = [v for v in views.views if v.trusted]
        majority = rejected_majority(trusted)
        if majority:
            trusted = majority
        elif len(views.accepted) >= 2 or (views.accepted and known_lately):
            self.reset()
            return None
        labelled = all(v.labelled for v in trusted)
        initiator = self._labelled if labelled else self._by_detector
        # what three cameras agree on is there, and need not be seen to move
        seen = [_candidate(v, labelled=labelled or bool(majority)) for v in trusted]
        # an epoch without two pixels counts as a miss
        found = initiator.step(t_s, seen if len({v.station for v in trusted}) >= 2 else [])
        return found[0].kinematics if found else None


def rejected_majority(views: Sequence[EpochView]) -> list[EpochView]:
    """Return the largest set of cameras whose rays meet, if it has a rejected pixel and is larger than the accepted.

    Empty where there is none; sets that are as large are told apart by how closely the rays meet.
    """
    accepted = sum(v.accepted for v in views)
    if accepted == len(views):
        return []
    for size in range(len(views), max(accepted, _MAJORITY - 1, len(views) - _MOST_OUT - 1), -1):
        meeting = []
        for chosen in itertools.combinations(views, size):
            point = triangulate([v.view for v in chosen])
            if point is not None and point.residual_sigma**2 <= chi_square_limit(_TAIL, 2 * size - 3):
                meeting.append((point.residual_sigma, chosen))
        if meeting:
            _, best = min(meeting, key=lambda pair: pair[0])
            return [] if all(v.accepted for v in best) else list(best)
    return []


def _candidate(view: EpochView, *, labelled: bool) -> CameraCandidate:
    """Return a pixel as a candidate of track initiation; one that is as sure as a label is confirmed without motion."""
    seen = view.view
    return CameraCandidate(
        t_s=view.t_s,
        station=view.station,
        pixel=seen.pixel,
        width_px=None,
        score=1.0,
        pan_rad=seen.pan_rad,
        tilt_rad=seen.tilt_rad,
        angle_sigma_rad=seen.angle_sigma_rad,
        labelled=labelled,
        sigma_px=float(np.sqrt(0.5 * np.trace(seen.covariance_px2))),
    )
