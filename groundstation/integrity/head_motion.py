"""Comparison of the motion of a station's pictures with the motion of its head's angles.

A head that turns moves the distant scene in the picture by an amount that the angles, the mount and the focal length
predict. For pairs of frames a fraction of a second apart, s is the measured shift of the scene and p(h) the shift that
the readings predict under a hypothesis h of how they were stored: those of another station, pan and tilt exchanged, a
sign reversed, radians taken for degrees, late or early by a constant time, a focal length that is wrong by a factor. A
pair agrees with h if |s − p(h)| is at most a share of the motion. Readings that are right agree in nearly all pairs.
If few agree, the hypothesis with which most agree names the fault; with none, only the disagreement is reported. If
most agree and are all off by one factor, it is the focal length's or the angles' (`motion_scale`).

The scene is what most corners of the picture belong to; an even sky gives no shift and no evidence. A scene that does
not move at all (a target that fills the picture, dirt on the lens) is no evidence for another hypothesis either, nor is
one that drifts by the same in all pairs, as clouds do, or that shakes while the head rests.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.geometry.ray_kernels import fill_centre_shifts
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.angle_series import AngleSeries
from groundstation.integrity.head_motion_fault import HeadMotionFault
from groundstation.integrity.motion_scale import MotionScale, motion_scale
from groundstation.integrity.reading_hypothesis import RIGHT, ReadingHypothesis, station_hypotheses
from groundstation.messages import Event, Frame, PtuSample
from groundstation.registration.picture_shift import is_cut, picture_shift, small_copy

# between the two frames of a pair: long against the exposure, short against the time a head takes across the picture
_PAIR_S = 0.2
_MAX_PAIR_S = 0.45
# pairs of one station that are kept; more are thinned out
_MAX_PAIRS = 160
# a pair decides only if the scene moved, or should have, by this many px and this many sigmas of the noise
_MOVED_PX, _MOVED_SIGMAS = 4.0, 5.0
# the shift of a textured scene is measured to 0.2 to 0.7 px (docs/notes/program.md); the rest is the encoders' noise
_SHIFT_SIGMA_PX = 0.5
# an agreeing pair differs by at most so many sigmas and such a share of the motion: distortion, depth of the scene
_AGREE_SIGMAS, _AGREE_SHARE = 2.5, 0.1
_MIN_DECIDING = 12
# a fault without a name needs more pairs, in which the head turns: a mast that shakes moves the pictures, too
_MIN_TURNING = 24
_RIGHT_SHARE, _WRONG_SHARE, _NAMED_SHARE = 0.5, 0.3, 0.6
# squared normalised difference beyond which a pair counts alike
_OUTLIER = 4.0
_FAR_M = 1e7
_NO_BOX = Box(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _PicturePair:
    """Two frames of a station: their times in s, the shift (2,) of the scene in px, and whether they are the same."""

    first_s: float
    second_s: float
    shift_px: FloatArray
    same: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Agreement:
    """Numbers of pairs that decide on a hypothesis and that agree with it, and its mean normalised square."""

    deciding: int
    agreeing: int
    cost: float

    @property
    def share(self) -> float:
        """Share of the deciding pairs that agree."""
        return self.agreeing / max(self.deciding, 1)


class HeadMotionMonitor:
    """Collects shifts of the pictures and readings of the heads during a run, and compares them at its end.

    ``stations`` are the stations that turn, by name, and ``angle_sigmas_rad`` one sigma of their readings. At
    most `_MAX_PAIRS` pairs a station are kept; the readings grow with the run (`AngleSeries`).
    """

    def __init__(self, stations: Mapping[str, StationGeometry], angle_sigmas_rad: Mapping[str, float]) -> None:
        self._stations = dict(stations)
        self._angle_sigmas_rad = dict(angle_sigmas_rad)
        self._angles = {name: AngleSeries() for name in stations}
        self._pairs: dict[str, list[_PicturePair]] = {name: [] for name in stations}
        self._kept: dict[str, tuple[float, ImageArray]] = {}
        self._next_s = dict.fromkeys(stations, -math.inf)
        self._every_s = dict.fromkeys(stations, _PAIR_S)

    def watched(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, and take from them what the comparison needs."""
        for event in events:
            if isinstance(event, PtuSample):
                self.add_reading(event)
            elif isinstance(event, Frame):
                self.add_frame(event)
            yield event

    def add_reading(self, sample: PtuSample) -> None:
        """Take a reading, in order of time."""
        if sample.station in self._angles:
            self._angles[sample.station].add(sample.t_s, sample.pan_rad, sample.tilt_rad)

    def add_frame(self, frame: Frame) -> None:
        """Take a frame, if its station turns and the last pair is long enough ago."""
        name, t_s = frame.station, frame.t_s
        if name not in self._stations or t_s < self._next_s[name] or not frame.image.has_all:
            return
        copy = small_copy(frame.image.preview())
        first = self._kept.pop(name, None)
        if first is None or not 0.0 < t_s - first[0] <= _MAX_PAIR_S or first[1].shape != copy.shape:
            self._keep(name, t_s, copy)
            return
        self._add_pair(name, first, (t_s, copy))
        if self._every_s[name] <= _PAIR_S:
            self._keep(name, t_s, copy)
        else:
            self._next_s[name] = first[0] + self._every_s[name]

    def _keep(self, name: str, t_s: float, copy: ImageArray) -> None:
        """Keep the first frame of a pair."""
        self._kept[name] = (t_s, copy)
        self._next_s[name] = t_s + _PAIR_S

    def _add_pair(self, name: str, first: tuple[float, ImageArray], second: tuple[float, ImageArray]) -> None:
        """Measure the shift of the scene between two frames; of too many pairs every second one is dropped."""
        if is_cut(first[1], second[1]):
            return
        shift_px = picture_shift(first[1], second[1], _NO_BOX)
        if shift_px is None:
            return
        pairs = self._pairs[name]
        same = np.array_equal(first[1], second[1])
        pairs.append(_PicturePair(first_s=first[0], second_s=second[0], shift_px=shift_px, same=same))
        if len(pairs) >= _MAX_PAIRS:
            del pairs[::2]
            self._every_s[name] *= 2.0

    def pair_count(self, name: str) -> int:
        """Return the number of pairs of a station's pictures of which the shift is known."""
        return len(self._pairs[name])

    def take_pictures_of(self, other: "HeadMotionMonitor") -> None:
        """Take the shifts that another monitor has measured, to compare them with other readings."""
        self._pairs = {name: list(other._pairs[name]) for name in self._stations}

    def refutes(self, name: str, hypothesis: ReadingHypothesis) -> bool:
        """Return whether a station's pictures move as its readings say, and not as they would by a hypothesis."""
        if not self.confirms(name):
            return False
        other = self._agreement(name, hypothesis)
        return other.deciding >= _MIN_DECIDING and other.share <= _WRONG_SHARE

    def confirms(self, name: str) -> bool:
        """Return whether a station's pictures move as its readings, its mount and its lens say."""
        if name not in self._stations:
            return False
        stored = self._agreement(name, RIGHT)
        return stored.deciding >= _MIN_DECIDING and stored.share >= _RIGHT_SHARE

    def faults(self) -> tuple[HeadMotionFault, ...]:
        """Return the stations whose readings contradict their pictures, in the order of the rig."""
        found = [self._fault(name) for name in self._stations]
        return tuple(fault for fault in found if fault is not None)

    def _fault(self, name: str) -> HeadMotionFault | None:
        """Return the fault of a station's readings; None if they are right, or if the pictures do not tell."""
        stored = self._agreement(name, RIGHT)
        # drifting clouds move by the same in each pair
        drifting = self._agreement(name, RIGHT, drift=True)
        if stored.deciding < _MIN_DECIDING:
            return None
        same = self._same(name)
        if same >= max(_MIN_DECIDING, _RIGHT_SHARE * stored.deciding):
            return replace(_fault_of(name, RIGHT, stored, stored), same=same)
        if max(stored.share, drifting.share) >= _RIGHT_SHARE:
            return self._scale_fault(name, stored)
        hypotheses = [(h, self._agreement(name, h)) for h in self._hypotheses(name)]
        judged = [(h, found) for h, found in hypotheses if found.deciding >= _MIN_DECIDING]
        best, agreement = min(judged, key=lambda pair: pair[1].cost)
        if agreement.share >= _NAMED_SHARE and stored.share <= 0.5 * agreement.share:
            return _fault_of(name, best, agreement, stored)
        turning = self._agreement(name, RIGHT, turning=True)
        if turning.deciding < _MIN_TURNING or turning.share > _WRONG_SHARE or not self._moves(name):
            return None
        return _fault_of(name, None, turning, turning)

    def _scale_fault(self, name: str, stored: _Agreement) -> HeadMotionFault | None:
        """Return a fault that leaves most pairs within their tolerance: a factor on all motions."""
        measured, predicted = self._shifts(name, RIGHT)
        lengths = np.maximum(np.linalg.norm(measured, axis=1), np.linalg.norm(predicted, axis=1))
        decides = lengths >= max(_MOVED_PX, _MOVED_SIGMAS * self._noise_px(name))
        scale = motion_scale(measured, predicted, decides)
        if scale is None:
            return None
        hypothesis = ReadingHypothesis(focal_factor=scale.ratio)
        return _fault_of(name, hypothesis, self._agreement(name, hypothesis), stored, scale)

    def _hypotheses(self, name: str) -> Iterator[ReadingHypothesis]:
        """Yield the hypotheses on a station."""
        yield from station_hypotheses([other for other in self._stations if other != name])
        factor = self._focal_factor(name)
        if factor is not None:
            yield ReadingHypothesis(focal_factor=factor)

    def _focal_factor(self, name: str) -> float | None:
        """Return the median ratio of the measured motion to the predicted one, along it; None without motion."""
        measured, predicted = self._shifts(name, RIGHT)
        length = np.einsum("ij,ij->i", predicted, predicted)
        moved = np.einsum("ij,ij->i", measured, measured) >= _MOVED_PX**2
        ratio = np.einsum("ij,ij->i", measured, predicted)[moved] / np.maximum(length[moved], 1e-12)
        factor = float(np.median(ratio)) if len(ratio) else 0.0
        return factor if factor > 0.0 else None

    def _agreement(
        self, name: str, hypothesis: ReadingHypothesis, *, drift: bool = False, turning: bool = False
    ) -> _Agreement:
        """Return how well the pairs in which something moved agree with a hypothesis.

        With ``drift`` the scene may have a motion of its own, the same in all pairs; with ``turning`` only pairs count
        in which the head turns by the readings.
        """
        measured, predicted = self._shifts(name, hypothesis)
        if drift and len(measured):
            predicted = predicted + np.median(measured - predicted, axis=0)
        turned = np.linalg.norm(predicted, axis=1)
        lengths = turned if turning else np.maximum(np.linalg.norm(measured, axis=1), turned)
        noise_px = self._noise_px(name, hypothesis.focal_factor)
        decides = lengths >= max(_MOVED_PX, _MOVED_SIGMAS * noise_px)
        limit = _AGREE_SIGMAS * noise_px + _AGREE_SHARE * lengths[decides]
        square = np.sum((measured - predicted)[decides] ** 2, axis=1) / limit**2
        return _Agreement(
            deciding=len(square),
            agreeing=int(np.count_nonzero(square <= 1.0)),
            cost=float(np.minimum(square, _OUTLIER).mean()) if len(square) else math.inf,
        )

    def _noise_px(self, name: str, focal_factor: float = 1.0) -> float:
        """Return one sigma of the difference of a measured and a predicted shift, px."""
        focal_px = focal_factor * float(self._stations[name].lens.focal_px.max())
        return math.hypot(_SHIFT_SIGMA_PX, math.sqrt(2.0) * self._angle_sigmas_rad[name] * focal_px)

    def _same(self, name: str) -> int:
        """Return how many pairs are of one picture although the head turned between its frames."""
        pairs = [pair for pair in self._pairs[name] if pair.same]
        predicted = np.linalg.norm(self._predicted(name, RIGHT, pairs), axis=1)
        return int(np.count_nonzero(predicted >= max(_MOVED_PX, _MOVED_SIGMAS * self._noise_px(name))))

    def _moves(self, name: str) -> bool:
        """Return whether the scene moves in most of the pairs that decide."""
        measured, predicted = (np.linalg.norm(shifts, axis=1) for shifts in self._shifts(name, RIGHT))
        least = max(_MOVED_PX, _MOVED_SIGMAS * self._noise_px(name))
        decides = np.maximum(measured, predicted) >= least
        return bool(np.mean(measured[decides] >= least) > _RIGHT_SHARE)

    def _shifts(self, name: str, hypothesis: ReadingHypothesis) -> tuple[FloatArray, FloatArray]:
        """Return measured and predicted shifts (n, 2) of the pairs for which there are readings."""
        pairs = self._pairs[name]
        measured = np.array([p.shift_px for p in pairs]).reshape(-1, 2)
        predicted = self._predicted(name, hypothesis, pairs)
        known = np.isfinite(predicted).all(axis=1)
        return measured[known], predicted[known]

    def _predicted(self, name: str, hypothesis: ReadingHypothesis, pairs: Sequence[_PicturePair]) -> FloatArray:
        """Return the shifts (n, 2) that the readings predict for n pairs; not a number where there are none."""
        angles = self._angles[hypothesis.source or name]
        first = angles.at(np.array([p.first_s for p in pairs]) - hypothesis.lag_s)
        second = angles.at(np.array([p.second_s for p in pairs]) - hypothesis.lag_s)
        before, after = (np.ascontiguousarray(hypothesis.angles(angles)) for angles in (first, second))
        predicted = np.empty((len(pairs), 2))
        fill_centre_shifts(self._stations[name].packed, before, after, _FAR_M, predicted)
        predicted *= hypothesis.focal_factor
        return predicted


def _fault_of(
    station: str,
    hypothesis: ReadingHypothesis | None,
    found: _Agreement,
    stored: _Agreement,
    scale: MotionScale | None = None,
) -> HeadMotionFault:
    """Return a fault with the pairs that agree under the hypothesis and with the readings as they are stored."""
    return HeadMotionFault(
        station=station,
        hypothesis=hypothesis,
        pairs=found.deciding,
        agreeing=found.agreeing,
        agreeing_as_stored=stored.agreeing,
        pairs_as_stored=stored.deciding,
        scale=scale,
    )
