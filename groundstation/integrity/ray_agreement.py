"""Agreement of the stations' rays to the target: do they meet, as pixels, angles and rig are stored?

Two stations that see one point have rays that meet. Pixels or angles exchanged between stations, angles of a wrong sign
or unit or time, and a wrong focal length turn the rays by degrees, so that they miss each other or diverge; errors of
calibration and of the detection are of hundredths of a degree. The miss of two rays is an angle: their gap over their
length where they pass each other in front of both stations, and the angle between their directions where they diverge.

Aircraft that the learned channel recognises in whole frames are compared first: with wrong angles a tracker finds two
things whose rays happen to meet, and not the aircraft that both cameras show.

If not most of the rays meet, the hypothesis with which they meet most often and most closely names the fault, if nearly
all of them do. Rays that are parallel within the tolerance tell nothing; angles in radians make all of them parallel.
Of two hypotheses that a mirror leads into each other, that which puts the target above the stations is preferred; what
cannot be told apart (in a symmetric approach pan of a wrong sign and exchanged stations) is named as alternatives.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.ray_kernels import fill_rays
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.angle_series import AngleSeries
from groundstation.integrity.ray_hypothesis import FOCAL_FACTORS, RayHypothesis
from groundstation.integrity.reading_hypothesis import (
    RIGHT,
    ReadingHypothesis,
    axis_hypotheses,
    lag_hypotheses,
    unit_hypotheses,
    zero_hypotheses,
)
from groundstation.messages import CameraReport, Detection, Event, PixelMeasurement, PtuSample

# by station: time, u and v of a pixel
_Views = Mapping[str, tuple[float, float, float]]

# pairs of rays miss each other by at most this: ten times what a usable calibration is off, and some px
_TOLERANCE_RAD, _TOLERANCE_PX = np.radians(0.2), 4.0
_MAX_EPOCHS = 200
_MIN_RAYS = 30
# shares of the rays that meet: below the first other hypotheses are tried, from the second on one is believed;
# share of the rays that miss each other from which on a fault is reported without a name
_RIGHT_SHARE, _NAMED_SHARE, _APART_SHARE = 0.65, 0.85, 0.7
# hypotheses with such a share of the best one's score are alternatives, of which so many are named
_ALIKE, _MAX_ALTERNATIVES = 0.97, 5
_NO_VIEW = (np.nan, np.nan, np.nan)
# angles that are off by less than this are for the filter and for `calibrate`
_LEAST_OFF_RAD = float(np.radians(0.5))
_LEAST_SINE = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class RayFault:
    """Rays of which too few meet: ``meeting_as_stored`` of ``rays_as_stored``.

    ``meeting`` of ``rays`` do under the first of the hypotheses, which explain the rays equally well; there are none
    if they meet under none.
    """

    hypotheses: tuple[RayHypothesis, ...]
    rays: int
    meeting: int
    rays_as_stored: int
    meeting_as_stored: int

    def line(self) -> str:
        """Return the fault as a line for people."""
        share = f"{self.meeting_as_stored} of {self.rays_as_stored}"
        text = f"the stations' rays to the target meet in {share} pairs of pixels"
        if not self.hypotheses:
            return f"{text}: rig, angles, clocks or pixels are wrong"
        words = ", or with ".join(hypothesis.words() for hypothesis in self.hypotheses)
        return f"{text}; they do with {words} ({self.meeting} of {self.rays})"


@dataclass(frozen=True, slots=True, kw_only=True)
class _RayCount:
    """Numbers of pairs of rays: all, those that meet, those that miss; the others are parallel.

    ``score`` is higher the more of them meet, and the closer.
    """

    rays: int
    meeting: int
    apart: int
    score: float

    @property
    def parallel(self) -> int:
        """Pairs that are parallel within the tolerance."""
        return self.rays - self.meeting - self.apart


class _EpochPixels:
    """Pixels of at most `_MAX_EPOCHS` epochs: of too many every second one is dropped."""

    def __init__(self) -> None:
        self._epochs: dict[int, dict[str, tuple[float, float, float]]] = {}
        self._every = 1

    def add(self, epoch: int, station: str, view: tuple[float, float, float]) -> None:
        if epoch % self._every:
            return
        self._epochs.setdefault(epoch, {})[station] = view
        if len(self._epochs) >= _MAX_EPOCHS:
            self._every *= 2
            self._epochs = {k: views for k, views in self._epochs.items() if k % self._every == 0}

    def views(self) -> list[_Views]:
        return list(self._epochs.values())


class RayAgreementMonitor:
    """Collects target pixels and readings during a run, and compares the stations' rays at its end.

    ``stations`` are all stations of the rig by name, ``turning`` the names of those that turn. At most
    `_MAX_EPOCHS` epochs are kept; the readings grow with the run (`AngleSeries`).
    """

    def __init__(self, stations: Mapping[str, StationGeometry], turning: Iterable[str]) -> None:
        self._stations = dict(stations)
        self._angles = {name: AngleSeries() for name in turning}
        self._targets, self._recognised = _EpochPixels(), _EpochPixels()

    def watched(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, and take from them what the comparison needs."""
        for event in events:
            if isinstance(event, PtuSample):
                if event.station in self._angles:
                    self._angles[event.station].add(event.t_s, event.pan_rad, event.tilt_rad)
            elif isinstance(event, PixelMeasurement):
                self.add_pixel(event.epoch, event.station, event.t_s, (event.u_px, event.v_px))
            yield event

    def add_report(self, report: CameraReport) -> None:
        """Take what one camera shows in a frame: what is taken for the target, and the likeliest aircraft."""
        found, likeliest = report.result, report.recognised
        if isinstance(found, Detection):
            self.add_pixel(report.epoch, report.station, report.t_s, (found.u_px, found.v_px))
        if likeliest is not None:
            self._recognised.add(report.epoch, report.station, (report.t_s, likeliest.u_px, likeliest.v_px))

    def add_pixel(self, epoch: int, station: str, t_s: float, pixel: tuple[float, float]) -> None:
        """Take the target's pixel in one frame; of too many epochs every second one is dropped."""
        if station in self._stations:
            self._targets.add(epoch, station, (t_s, *pixel))

    def meet(self) -> bool:
        """Return whether most rays meet as they are stored: to the target, and to recognised aircraft if there are any.

        Of too few rays it is not known, and False.
        """
        stored = [self._count(RayHypothesis(), of.views()) for of in (self._targets, self._recognised)]
        known = [count for count in stored if count.rays >= _MIN_RAYS]
        return bool(known) and all(count.meeting >= _RIGHT_SHARE * count.rays for count in known)

    def fault(self, refuted: Callable[[str, ReadingHypothesis], bool] = lambda name, reading: False) -> RayFault | None:
        """Return the fault; None if most rays meet, or if there are too few pixels to tell.

        ``refuted`` returns whether something else speaks against a hypothesis on a station's readings and its lens.

        Aircraft recognised in whole frames name a fault if they can. They tell nothing without a name: two cameras may
        recognise two things.
        """
        recognised = self._fault_of(self._recognised.views(), refuted)
        if recognised is not None and recognised.hypotheses:
            return recognised
        return self._fault_of(self._targets.views(), refuted)

    def _fault_of(self, epochs: Sequence[_Views], refuted: Callable[[str, ReadingHypothesis], bool]) -> RayFault | None:
        """Return the fault that the pixels of some epochs show, by station."""
        stored = self._count(RayHypothesis(), epochs)
        if stored.rays < _MIN_RAYS or stored.meeting >= _RIGHT_SHARE * stored.rays:
            return None
        counts = [(hypothesis, self._count(hypothesis, epochs)) for hypothesis in self._hypotheses(epochs)]
        explaining = [
            pair for pair in counts if pair[1].meeting >= _NAMED_SHARE * pair[1].rays >= _NAMED_SHARE * _MIN_RAYS
        ]
        explaining = [pair for pair in _without_endless(explaining) if not pair[0].is_refuted(refuted)]
        named = bool(explaining)
        found = max(explaining, key=lambda pair: pair[1].score)[1] if named else stored
        if not named and stored.apart < _APART_SHARE * stored.rays:
            return None
        return RayFault(
            hypotheses=_alternatives(explaining, found.score) if named else (),
            rays=found.rays,
            meeting=found.meeting,
            rays_as_stored=stored.rays,
            meeting_as_stored=stored.meeting,
        )

    def _hypotheses(self, epochs: Sequence[_Views]) -> Iterator[RayHypothesis]:
        """Yield hypotheses, the simplest first: those of all stations, then those of one."""
        turning = list(self._angles)
        for pair in itertools.combinations(turning, 2):
            a, b = pair
            exchanged = {a: ReadingHypothesis(source=b), b: ReadingHypothesis(source=a)}
            yield RayHypothesis(readings=exchanged)
            yield RayHypothesis(readings=exchanged, pixels_exchanged=pair)
            yield RayHypothesis(places_exchanged=pair)
        for pair in itertools.combinations(self._stations, 2):
            yield RayHypothesis(pixels_exchanged=pair)
            yield RayHypothesis(lenses_exchanged=pair)
        of_heads = [*axis_hypotheses(), *zero_hypotheses(), *unit_hypotheses(), *lag_hypotheses()] if turning else []
        of_lenses = [ReadingHypothesis(focal_factor=float(f)) for f in FOCAL_FACTORS]
        of_heads = [hypothesis for hypothesis in of_heads if hypothesis != RIGHT]
        for hypothesis in of_heads:
            yield RayHypothesis(readings=dict.fromkeys(turning, hypothesis))
        for hypothesis in of_lenses:
            yield RayHypothesis(readings=dict.fromkeys(self._stations, hypothesis))
        if len(self._stations) > 1:
            for name in self._stations:
                for hypothesis in [h for h in of_heads if not h.lag_s] if name in self._angles else []:
                    yield RayHypothesis(readings={name: hypothesis})
                for hypothesis in of_lenses:
                    yield RayHypothesis(readings={name: hypothesis})
            for name, reading in self._offsets(epochs):
                yield RayHypothesis(readings={name: reading})

    def _offsets(self, epochs: Sequence[_Views]) -> Iterator[tuple[str, ReadingHypothesis]]:
        """Yield what a station's tilt and pan may be off: rays as high as the others', and such that do not diverge."""
        directions = self._rays(RayHypothesis(), epochs)[1]
        high = {name: np.arctan2(d[:, 2], np.hypot(d[:, 0], d[:, 1])) for name, d in directions.items()}
        aside = {name: np.arctan2(d[:, 0], d[:, 1]) for name, d in directions.items()}
        for name in self._angles:
            others = [other for other in self._stations if other != name]
            higher = _percentile(50.0, [high[other] - high[name] for other in others])
            if abs(higher) >= _LEAST_OFF_RAD:
                yield name, ReadingHypothesis(tilt_off_rad=higher)
            # turned by a little more than they diverge all of them converge; nothing tells by how much more it is
            apart = _percentile(95.0, [np.abs(aside[other] - aside[name]) for other in others])
            for sign in (1.0, -1.0) if apart >= _LEAST_OFF_RAD else ():
                yield name, ReadingHypothesis(pan_off_rad=sign * (apart + 2.0 * _TOLERANCE_RAD))

    def _count(self, hypothesis: RayHypothesis, epochs: Sequence[_Views]) -> _RayCount:
        """Count the pairs of rays of some epochs under a hypothesis."""
        origins, directions = self._rays(hypothesis, epochs)
        misses, angles, limits, aboves = [], [], [], []
        for a, b in itertools.combinations(self._stations, 2):
            miss, angle = _miss(origins[a], directions[a], origins[b], directions[b])
            focal_px = min(float(self._stations[n].lens.focal_px.min()) for n in (a, b))
            known = np.isfinite(miss)
            misses.append(miss[known])
            angles.append(angle[known])
            limits.append(np.full(int(known.sum()), _TOLERANCE_RAD + _TOLERANCE_PX / focal_px))
            aboves.append(directions[a][known, 2] + directions[b][known, 2] > 0.0)
        miss, angle, limit = np.concatenate(misses), np.concatenate(angles), np.concatenate(limits)
        above = np.concatenate(aboves)
        meeting = (miss <= limit) & (angle > limit)
        return _RayCount(
            rays=len(miss),
            meeting=int(meeting.sum()),
            apart=int((miss > limit).sum()),
            score=float(np.sum((1.0 - 0.5 * miss / limit + 0.5 * above)[meeting])),
        )

    def _rays(
        self, hypothesis: RayHypothesis, epochs: Sequence[_Views]
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return origins and directions (n, 3) of each station's rays of n epochs; not a number where there is none."""
        other = {name: name for name in self._stations}
        if hypothesis.pixels_exchanged is not None:
            a, b = hypothesis.pixels_exchanged
            other[a], other[b] = b, a
        stations = dict(self._stations)
        if hypothesis.lenses_exchanged is not None:
            a, b = hypothesis.lenses_exchanged
            stations[a], stations[b] = stations[a].with_lens(stations[b].lens), stations[b].with_lens(stations[a].lens)
        origins, directions = {}, {}
        for name, geometry in stations.items():
            stored = np.array([views.get(other[name], _NO_VIEW) for views in epochs]).reshape(-1, 3)
            reading = hypothesis.readings.get(name, RIGHT)
            angles = np.zeros((len(stored), 2))
            if name in self._angles:
                angles = reading.angles(self._angles[reading.source or name].at(stored[:, 0] - reading.lag_s))
            origins[name], directions[name] = _rays_of(geometry, stored[:, 1:], angles, reading.focal_factor)
        if hypothesis.places_exchanged is not None:
            a, b = hypothesis.places_exchanged
            origins[a], origins[b] = origins[b], origins[a]
        return origins, directions


def _percentile(percent: float, parts: Sequence[FloatArray]) -> float:
    """Return a percentile of all finite numbers; 0 if there are none."""
    numbers = np.concatenate(parts)
    numbers = numbers[np.isfinite(numbers)]
    return float(np.percentile(numbers, percent)) if len(numbers) else 0.0


def _alternatives(counts: Sequence[tuple[RayHypothesis, _RayCount]], score: float) -> tuple[RayHypothesis, ...]:
    """Return the hypotheses that are as good as that of the best score, best first, one of each kind."""
    best_first = sorted(counts, key=lambda pair: -pair[1].score)
    best_tilt = any(h.tilt_off_rad for h in best_first[0][0].readings.values())
    kinds: dict[str, RayHypothesis] = {}
    for hypothesis, count in best_first:
        # rays as high as the others' may be so by either tilt, even where one has the aircraft below the stations
        either = best_tilt and any(h.tilt_off_rad for h in hypothesis.readings.values())
        if count.score >= _ALIKE * score or either:
            kinds.setdefault(str(hypothesis.kind()), hypothesis)
    return tuple(sorted(list(kinds.values())[:_MAX_ALTERNATIVES], key=_rank))


def _rank(hypothesis: RayHypothesis) -> int:
    """Return the place among alternatives: videos are exchanged by a name, lenses by an edit of the rig.

    Rays seldom tell the two apart; and principal points that differ make either look like a tilt that is off.
    """
    if hypothesis.pixels_exchanged is not None and not hypothesis.readings:
        return 0
    return 1 if hypothesis.lenses_exchanged is not None else 2


def _without_endless(counts: Sequence[tuple[RayHypothesis, _RayCount]]) -> list[tuple[RayHypothesis, _RayCount]]:
    """Return hypotheses without the focal lengths of a kind of which the longest one tried is the best."""
    best: dict[str, tuple[RayHypothesis, _RayCount]] = {}
    for hypothesis, count in counts:
        kind = str(hypothesis.kind())
        if kind not in best or count.score > best[kind][1].score:
            best[kind] = (hypothesis, count)
    return [pair for pair in counts if not best[str(pair[0].kind())][0].is_endless()]


def _rays_of(
    geometry: StationGeometry, pixels: FloatArray, angles: FloatArray, focal_factor: float
) -> tuple[FloatArray, FloatArray]:
    """Return origins and directions (n, 3) of the rays of pixels (n, 2) in a lens ``focal_factor`` as long."""
    origins, directions = np.full((len(pixels), 3), np.nan), np.full((len(pixels), 3), np.nan)
    centre = geometry.lens.principal_point_px
    scaled = centre + (pixels - centre) / focal_factor
    fill_rays(geometry.packed, scaled, np.ascontiguousarray(angles), origins, directions)
    return origins, directions


def _miss(o1: FloatArray, d1: FloatArray, o2: FloatArray, d2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by what angles (n,) n pairs of rays miss each other, and the angles between their directions, rad."""
    cross = np.cross(d1, d2)
    sine = np.linalg.norm(cross, axis=1)
    angle = np.arctan2(sine, np.einsum("ij,ij->i", d1, d2))
    between, square = o2 - o1, np.maximum(sine**2, _LEAST_SINE**2)
    along_1 = np.einsum("ij,ij->i", np.cross(between, d2), cross) / square
    along_2 = np.einsum("ij,ij->i", np.cross(between, d1), cross) / square
    gap = np.abs(np.einsum("ij,ij->i", between, cross)) / np.sqrt(square)
    nearer = np.minimum(along_1, along_2)
    return np.where(nearer > 0.0, np.arctan2(gap, nearer), angle), angle
