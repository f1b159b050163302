"""What is wrong with a whole table of landmarks or sightings: axes, signs, units and columns, each tried in turn.

One wrong landmark is found by leaving it out (`rejection`). Where most disagree, the fault is one of all rows: every
hypothesis below is applied to the table, and is named where the landmarks then fit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.landmarks.angles import gather_observations
from calibration.landmarks.rejection import LandmarkFitError
from calibration.landmarks.survey import require_most_kept, seen_landmarks, solve_survey
from calibration.landmarks.survey_start import bearing_misses
from calibration.sightings import Landmark, LandmarkSighting
from groundstation.arrays import FloatArray
from groundstation.errors import GroundstationError
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import Rig, Station

# chosen: of a hypothesis, landmarks miss by so much at most, and by so much less than as they stand
_MOST_MISS_RAD = float(np.radians(0.2))
_BETTER = 2.0
# chosen: a landmark that is off by more than lens, mount and head explain
_OFF_RAD = float(np.radians(0.1))
_ROWS = 3
# chosen: one landmark of so many may be a mistake of its own
_SPARED = 5
_CONFIRMED = 3
# what becomes of a survey by a hypothesis
_FITS, _UPRIGHT = 1, 2

Mark = Callable[[FloatArray], FloatArray]
Change = Callable[[LandmarkSighting, Station], LandmarkSighting]


@dataclass(frozen=True, slots=True, kw_only=True)
class SystematicFault:
    """A hypothesis: how the rows would be put right, and the words for it.

    ``words`` completes "fit with", ``wanted`` says how the table should be.
    """

    words: str
    wanted: str
    mark: Mark | None = None
    change: Change | None = None
    exchanged: tuple[str, str] | None = None
    scale: bool = False

    def landmarks(self, landmarks: Mapping[str, Landmark]) -> dict[str, Landmark]:
        """Return the table of landmarks as it would be."""
        if self.mark is None:
            return dict(landmarks)
        return {
            name: one
            if one.place is None or (self.scale and one.kind == "direction")
            else replace(one, place=self.mark(one.place))
            for name, one in landmarks.items()
        }

    def sightings(self, sightings: Sequence[LandmarkSighting], rig: Rig) -> list[LandmarkSighting]:
        """Return the table of sightings as it would be."""
        found = list(sightings)
        if self.exchanged is not None:
            a, b = self.exchanged
            names = {a: b, b: a}
            found = [replace(one, station=names.get(one.station, one.station)) for one in found]
        if self.change is not None:
            found = [self.change(one, rig[one.station]) for one in found]
        return found

    def station_of(self, name: str) -> str:
        """Return of which station the rows of a station would be."""
        if self.exchanged is None or name not in self.exchanged:
            return name
        return self.exchanged[1 - self.exchanged.index(name)]


def explained(
    fault: LandmarkFitError,
    rig: Rig,
    sightings: Sequence[LandmarkSighting],
    landmarks: Mapping[str, Landmark],
    files: tuple[Path, Path],
) -> LandmarkFitError:
    """Return the error of a survey that fails, with the fault of a whole table in its place where one explains it.

    ``files`` are those of sightings and landmarks, for the message.
    """
    few = _thinned(sightings)
    names = [s.name for s in rig.stations if any(one.station == s.name for one in few)]
    stated = {name: _misses(rig, name, few, landmarks) for name in names}
    misfits = {name: _misfit(rig[name], stated[name], unjudged=0.0) for name in names}
    wrong = [name for name in names if misfits[name] > _OFF_RAD / 2.0]
    if not wrong:
        return fault
    most = {name: min(_MOST_MISS_RAD, misfits[name] / _BETTER) for name in wrong}
    found: list[tuple[float, SystematicFault]] = []
    for one in systematic_faults(rig, names):
        miss = _miss_by(one, rig, most, few, landmarks)
        if miss is not None:
            found.append((miss, one))
    # of those that fit alike, as reflections do where places are free, the order of the list decides
    least = min((miss for miss, _ in found), default=0.0)
    found.sort(key=lambda pair: pair[0] > 1.5 * least)
    results = [(one, miss, _fits(one, rig, wrong, few, landmarks, files[0])) for miss, one in found[:_CONFIRMED]]
    # heads stand upright, but for those that hang
    for good in (_UPRIGHT, _FITS):
        confirmed = [(miss, one) for one, miss, how in results if how >= good]
        if confirmed:
            return _named(confirmed, wrong if len(wrong) < len(names) else [], files)
    return _whole(fault, rig, stated)


def systematic_faults(rig: Rig, stations: Sequence[str]) -> list[SystematicFault]:
    """Return the hypotheses for a survey of these stations."""
    pairs = [(a, b) for k, a in enumerate(stations) for b in stations[k + 1 :]]
    exchanged = [
        SystematicFault(words=f"the stations {a} and {b} exchanged", wanted="each row's own station", exchanged=(a, b))
        for a, b in pairs
    ]
    return [*exchanged, *_FAULTS]


def _axes(words: str, *rows: tuple[float, float, float]) -> SystematicFault:
    turn = np.array(rows)
    wanted = "x to the right, y along the runway, z up, in m, in the rig's frame"
    return SystematicFault(words=words, wanted=wanted, mark=lambda place: turn @ place)


def _unit(name: str, metres: float) -> SystematicFault:
    return SystematicFault(words=f"places in {name}", wanted="m", mark=lambda place: metres * place, scale=True)


def _angles(words: str, pan: tuple[float, float], tilt: tuple[float, float]) -> SystematicFault:
    """Return the hypothesis that true pan and tilt are these multiples of the pan and tilt that the table has."""

    def change(one: LandmarkSighting, _: Station) -> LandmarkSighting:
        return replace(
            one,
            pan_rad=pan[0] * one.pan_rad + pan[1] * one.tilt_rad,
            tilt_rad=tilt[0] * one.pan_rad + tilt[1] * one.tilt_rad,
        )

    return SystematicFault(words=words, wanted="deg, pan to the left and tilt upwards, in their columns", change=change)


def _pixels(words: str, move: Callable[[FloatArray, FloatArray], FloatArray]) -> SystematicFault:
    def change(one: LandmarkSighting, station: Station) -> LandmarkSighting:
        return replace(one, pixel_px=move(one.pixel_px, np.array(station.lens.image_size_px, dtype=np.float64)))

    wanted = "u to the right and v down from the upper left pixel, of the picture of which the lens is"
    return SystematicFault(words=words, wanted=wanted, change=change)


def _resized(factor: float, name: str) -> SystematicFault:
    return _pixels(f"pixels of a picture {name} times as wide as the lens's", lambda uv, _: (uv + 0.5) * factor - 0.5)


_FAULTS = (
    _axes("z reversed", (1, 0, 0), (0, 1, 0), (0, 0, -1)),
    _axes("x and y exchanged", (0, 1, 0), (1, 0, 0), (0, 0, 1)),
    _axes("x and y exchanged and z reversed", (0, 1, 0), (1, 0, 0), (0, 0, -1)),
    _axes("y and z exchanged", (1, 0, 0), (0, 0, 1), (0, 1, 0)),
    _axes("x reversed", (-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    _axes("y reversed", (1, 0, 0), (0, -1, 0), (0, 0, 1)),
    _axes("x and y reversed", (-1, 0, 0), (0, -1, 0), (0, 0, 1)),
    _unit("feet", 0.3048),
    _unit("mm", 1e-3),
    _unit("cm", 1e-2),
    _unit("km", 1e3),
    _pixels("u and v exchanged", lambda uv, _: uv[::-1]),
    _pixels("v counted from below", lambda uv, size: np.array([uv[0], size[1] - 1.0 - uv[1]])),
    _pixels("u counted from the right", lambda uv, size: np.array([size[0] - 1.0 - uv[0], uv[1]])),
    _pixels("pictures upside down", lambda uv, size: size - 1.0 - uv),
    _pixels("pixels from the picture's middle", lambda uv, size: uv + 0.5 * (size - 1.0)),
    *(_resized(1.0 / share, name) for share, name in ((0.25, "0.25"), (1 / 3, "0.33"), (0.5, "0.5"), (2 / 3, "0.67"))),
    *(_resized(1.0 / times, f"{times:g}") for times in (1.5, 2.0, 3.0, 4.0)),
    _angles("pan reversed", (-1.0, 0.0), (0.0, 1.0)),
    _angles("tilt reversed", (1.0, 0.0), (0.0, -1.0)),
    _angles("pan and tilt reversed", (-1.0, 0.0), (0.0, -1.0)),
    _angles("pan and tilt exchanged", (0.0, 1.0), (1.0, 0.0)),
    _angles("angles in radians", (float(np.degrees(1.0)), 0.0), (0.0, float(np.degrees(1.0)))),
    _angles("angles in gradians", (0.9, 0.0), (0.0, 0.9)),
    _angles("angles in thousandths of a radian", (np.degrees(1e-3), 0.0), (0.0, np.degrees(1e-3))),
)


def _thinned(sightings: Sequence[LandmarkSighting]) -> list[LandmarkSighting]:
    """Return a few rows of each landmark from each station, in their order: a hypothesis needs no more."""
    rows: dict[tuple[str, str], list[int]] = {}
    for k, one in enumerate(sightings):
        rows.setdefault((one.station, one.landmark), []).append(k)
    chosen = {own[int(j)] for own in rows.values() for j in np.linspace(0, len(own) - 1, min(_ROWS, len(own)))}
    return [sightings[k] for k in sorted(chosen)]


def _misses(
    rig: Rig, name: str, sightings: Sequence[LandmarkSighting], landmarks: Mapping[str, Landmark]
) -> FloatArray | None:
    """Return by which angle (k,) each landmark is off in the best pose of a station; None where it has none."""
    own = [one for one in sightings if one.station == name]
    marks = seen_landmarks(own, landmarks, Path("sightings"))
    observed = gather_observations(own, rig[name], {mark.name: k for k, mark in enumerate(marks)})
    try:
        return bearing_misses(rig[name], observed, marks)
    except GroundstationError:
        return None


def _miss_by(
    one: SystematicFault,
    rig: Rig,
    most: Mapping[str, float],
    sightings: Sequence[LandmarkSighting],
    landmarks: Mapping[str, Landmark],
) -> float | None:
    """Return by which angle the rows of wrong stations are off by a hypothesis; None if by more than ``most`` of each.

    The same rows are judged as were as they stand: of exchanged stations those of the other one.
    """
    marks, seen = one.landmarks(landmarks), one.sightings(sightings, rig)
    worst = 0.0
    for name, limit in most.items():
        own = one.station_of(name)
        count = len({row.landmark for row in seen if row.station == own})
        misses = _misses(rig, own, seen, marks)
        # rows that the lens has no rays for any more are not explained
        if misses is None or len(misses) < count - count // _SPARED:
            return None
        worst = max(worst, _misfit(rig[own], misses, unjudged=float("inf")))
        if worst > limit:
            return None
    return worst


def _misfit(station: Station, misses: FloatArray | None, *, unjudged: float) -> float:
    """Return by which angle landmarks are off, their unknowns counted, without the worst of five; infinite for none.

    One landmark more than a pose needs is left to judge it; with none, nearly any fit is exact, and the answer is
    ``unjudged``.
    """
    unknowns = 3 if "position" in station.known else 6
    if misses is None:
        return float("inf")
    if 2 * len(misses) < unknowns + 2:
        return unjudged
    kept = np.sort(misses)[: len(misses) - len(misses) // _SPARED]
    freedom = max(2 * len(kept) - unknowns, 1)
    return float(np.sqrt(2.0 * np.sum(kept**2) / freedom))


def _fits(
    one: SystematicFault,
    rig: Rig,
    stations: Sequence[str],
    sightings: Sequence[LandmarkSighting],
    landmarks: Mapping[str, Landmark],
    path: Path,
) -> int:
    """Return whether a survey of these stations succeeds by a hypothesis, and whether heads are then upright.

    Of stations that the hypothesis exchanges both have to: a fault of one must not become the other's.
    """
    stations = sorted({*stations, *(one.exchanged or ())})
    seen = [s for s in one.sightings(sightings, rig) if s.station in stations]
    try:
        survey = solve_survey(rig, seen, one.landmarks(landmarks), (), path)
        for name in stations:
            require_most_kept(survey.fit, name)
    except GroundstationError:
        return 0
    upright = all(matrix_from_wxyz(survey.rig[name].runway_from_base_wxyz)[2, 2] > 0.0 for name in stations)
    return _UPRIGHT if upright else _FITS


def _named(
    found: Sequence[tuple[float, SystematicFault]], stations: Sequence[str], files: tuple[Path, Path]
) -> LandmarkFitError:
    miss, first = found[0]
    where = files[1].name if first.mark is not None else files[0].name
    whose = f" of station {', '.join(stations)}" if stations else ""
    what = (
        "landmarks that contradict the sightings" if first.mark is not None else "sightings that contradict the marks"
    )
    words = ", or with ".join(one.words for _, one in found)
    return LandmarkFitError(
        f"{where}: got {what}{whose} as they stand, but that fit (to {np.degrees(miss):.2g} deg) with {words};"
        f" wanted {first.wanted}"
    )


def _whole(fault: LandmarkFitError, rig: Rig, stated: Mapping[str, FloatArray | None]) -> LandmarkFitError:
    """Return the error, or one that blames no single landmark where most of a station's are off."""
    for name, misses in stated.items():
        if misses is None:
            continue
        off = misses[misses > _OFF_RAD]
        if len(off) > max(1, len(misses) // 4) and _misfit(rig[name], misses, unjudged=0.0) > _OFF_RAD:
            got = (
                f"{len(off)} of {len(misses)} landmarks off by {np.degrees(off.min()):.2g} to"
                f" {np.degrees(off.max()):.2g} deg in the pose that fits best, which is more than single mistakes"
            )
            wanted = "sightings of the landmarks they name, with axes, units, angles, lens and mount of this rig"
            return LandmarkFitError(f"station {name}: got {got}; wanted {wanted}")
    return fault
