"""A detector of one's own in place of the program's: a function that is given a picture, a region and a hint.

The function is called with the whole picture, the part of it to look at, and the filter's prediction; while no target
is tracked, with the whole picture as region and None as hint. It returns candidates with their covariance, an empty
sequence where it looked and saw nothing, or None where it did not look: an empty one lowers the probability that
the target exists, None changes nothing.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, box_of_size
from groundstation.detection.candidate_finder import Candidate
from groundstation.detection.config import DetectionConfig
from groundstation.detection.working_image import DetectionHint
from groundstation.detection_messages import Detection, Miss, MissReason
from groundstation.errors import InputError
from groundstation.geometry.mahalanobis import mahalanobis_squared
from groundstation.picture import Picture, as_picture


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetCandidate:
    """Something in a picture that may be the aircraft.

    Attributes
    ----------
    u_px, v_px : the target point (the aircraft's nose) in full-image pixels.
    covariance_px2 : (2, 2) covariance of that point, of u and v.
    width_px : width of the silhouette; with it the range is estimated while only one camera sees the target. None if
        unknown.
    log_odds : that it is the aircraft and not something else; 0 is even odds, also for a detector that gives none.
    """

    u_px: float
    v_px: float
    covariance_px2: FloatArray
    width_px: float | None = None
    log_odds: float = 0.0


DetectorCallback = Callable[[ImageArray, Box[int], DetectionHint | None], Sequence[TargetCandidate] | None]


class CallbackDetector:
    """Finds the target of one camera near its prediction by a function.

    Parameters
    ----------
    station : name of the camera's station, for error messages.
    """

    def __init__(self, callback: DetectorCallback, config: DetectionConfig, station: str) -> None:
        self._callback, self._gate, self._station = callback, config.gate_sigmas, station

    def reset(self) -> None:
        """Do nothing: the function's state is its own."""

    @contextmanager
    def state_preserved(self) -> Iterator[None]:
        """Do nothing: the function's state is its own."""
        yield

    def detect(self, image: ImageArray | Picture, roi: Box[int], hint: DetectionHint) -> Detection | Miss:
        """Return the likeliest candidate near the prediction. Raises `InputError` for a value that is none."""
        found = _candidates(self._callback, self._station, as_picture(image), roi, hint)
        if found is None:
            return Miss(reason=MissReason.NOT_SEARCHED, detail="the detector did not look")
        if not found:
            return Miss(reason=MissReason.NO_REGION, detail="the detector saw nothing")
        near = [(_distance(c, hint), c) for c in found]
        near = [(distance, c) for distance, c in near if distance <= self._gate**2]
        if not near:
            return Miss(reason=MissReason.NO_REGION, detail="all candidates are too far from the prediction")
        _, best = max(near, key=lambda each: each[1].log_odds - 0.5 * each[0])
        covariance = np.array(best.covariance_px2, np.float64)
        return Detection(
            u_px=float(best.u_px),
            v_px=float(best.v_px),
            covariance_px2=covariance,
            noise_px2=covariance,
            centroid_px=np.array([best.u_px, best.v_px], np.float64),
            box=_box(best),
            area_px=0.0,
            contour_px=np.empty((0, 2), np.float32),
            contrast_to_noise=0.0,
            channel="callback",
        )


class CallbackFinder:
    """Searches whole frames of one camera by a function."""

    def __init__(self, callback: DetectorCallback, station: str) -> None:
        self._callback, self._station = callback, station

    def reset(self) -> None:
        """Do nothing: the function's state is its own."""

    def find(
        self,
        image: ImageArray | Picture,
        t_s: float,
        camera_from_runway: FloatArray | None = None,
        places: Sequence[tuple[FloatArray, float]] = (),
    ) -> tuple[Candidate, ...]:
        """Return the candidates of a frame, likeliest first; arguments as of `CandidateFinder.find`."""
        picture = as_picture(image)
        found = _candidates(self._callback, self._station, picture, Box(0, 0, *picture.size_px), None) or ()
        likeliest = sorted(found, key=lambda c: -c.log_odds)
        return tuple(
            Candidate(
                u_px=float(c.u_px),
                v_px=float(c.v_px),
                box=_box(c),
                score=1.0 / (1.0 + math.exp(-min(max(c.log_odds, -_MOST_ODDS), _MOST_ODDS))),
                moving=False,
                motion_px_s=None,
                sigma_px=math.sqrt(0.5 * float(np.trace(c.covariance_px2))),
                odds=None,
            )
            for c in likeliest
        )


# beyond these the probability rounds to 0 or 1
_MOST_ODDS = 30.0


def for_stations(
    detector: DetectorCallback | Mapping[str, DetectorCallback] | None, stations: Sequence[str]
) -> Mapping[str, DetectorCallback]:
    """Return the function of each station; one function serves all. Raises `InputError` for a name of no station."""
    if detector is None:
        return {}
    if not isinstance(detector, Mapping):
        return dict.fromkeys(stations, detector)
    for name in detector:
        if name not in stations:
            raise InputError("detectors", got=repr(name), wanted="names of stations: " + ", ".join(stations))
    return detector


def _candidates(
    callback: DetectorCallback, station: str, picture: Picture, region: Box[int], hint: DetectionHint | None
) -> list[TargetCandidate] | None:
    """Call the function; return its candidates, checked, or None where it did not look."""
    image = (picture.whole() if picture.has_all else picture.preview()).view()
    image.flags.writeable = False
    answer: object = callback(image, region, hint)
    if answer is None:
        return None
    where = f"detector of {station}"
    if not isinstance(answer, Iterable):
        raise InputError(where, got=type(answer).__name__, wanted="TargetCandidate, in a sequence, or None")
    return [_checked(candidate, where) for candidate in answer]


def _checked(candidate: object, where: str) -> TargetCandidate:
    """Return a candidate; raises `InputError` for what is none."""
    if not isinstance(candidate, TargetCandidate):
        raise InputError(where, got=type(candidate).__name__, wanted="TargetCandidate, in a sequence, or None")
    covariance = np.asarray(candidate.covariance_px2, np.float64)
    if covariance.shape != (2, 2):
        raise InputError(f"{where}: covariance_px2", got=f"shape {covariance.shape}", wanted="(2, 2)")
    numbers = np.array(
        [candidate.u_px, candidate.v_px, candidate.log_odds, candidate.width_px or 1.0, *covariance.flat]
    )
    if not np.isfinite(numbers).all():
        raise InputError(where, got="a value that is not finite", wanted="finite numbers")
    if candidate.width_px is not None and candidate.width_px <= 0.0:
        raise InputError(f"{where}: width_px", got=f"{candidate.width_px:g}", wanted="> 0, or None")
    if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise InputError(
            f"{where}: covariance_px2", got=str(covariance.tolist()), wanted="symmetric, positive definite"
        )
    return candidate


def _distance(candidate: TargetCandidate, hint: DetectionHint) -> float:
    """Return the squared distance of a candidate from the prediction, in sigmas of both."""
    away = np.array([candidate.u_px, candidate.v_px]) - hint.predicted_px
    return mahalanobis_squared(away, hint.predicted_covariance_px2 + np.asarray(candidate.covariance_px2, np.float64))


def _box(candidate: TargetCandidate) -> Box[float]:
    """Return a box around a candidate, as wide as it is known to be."""
    width = candidate.width_px or 0.0
    return box_of_size(candidate.u_px - 0.5 * width, candidate.v_px, width, 0.0)
