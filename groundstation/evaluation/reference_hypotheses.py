"""Whether track and reference can be of one flight in one frame, and if not, which usual fault would make them agree.

A reference in feet, with x and y exchanged or an axis reversed, from another origin, height or azimuth, or by a clock
that is off by more than the comparison looks for, and a track that is too far away by one factor, as a wrong baseline
or focal length makes it, leave distances between both that no error of a filter explains. The distance is the median
over the epochs, at the offset of the clocks with which it is least. Hypotheses are tried only where it is large as they
are stored; across the line of sight, where cameras are exact, less is large.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import BoolArray, PositionSeries, ReferenceSeries, is_gap
from groundstation.geometry.rotation import rotation_z

_MOST_EPOCHS, _LEAST_EPOCHS = 200, 30
_OFFSET_STEP_S = 0.1
# distances are large from this share of the range and so many stated sigmas on; a filter that is 6 % off in range and
# says so is none of these faults
_LEAST_SHARE, _LEAST_ACROSS_SHARE, _LEAST_SIGMAS, _LEAST_M = 0.1, 0.05, 5.0, 3.0
# offsets of the clocks beyond those that a comparison looks for, and how many are tried
_FAR_STEP_S, _MOST_FAR_STEPS = 0.5, 2000
# a reference that is turned by less is no other azimuth's
_LEAST_TURN_DEG = 3.0
# a hypothesis explains what leaves at most this share of the distance
_LEFT_SHARE = 0.2
_FOOT_M = 0.3048
# factors so close to a unit's are named as it
_SAME_FACTOR = 0.03


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ReferenceHypothesis:
    """A reference's axes: ``order`` (3,) of them and ``signs`` (3,), and what is fitted.

    That is a factor, a turn about the vertical or a displacement; ``far``: a clock that is off by more.
    """

    words: str
    order: tuple[int, ...] = (0, 1, 2)
    signs: tuple[float, ...] = (1.0, 1.0, 1.0)
    scaled: bool = False
    turned: bool = False
    displaced: bool = False
    far: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _DistanceFit:
    """The median distance, m, that across the line of sight, and with which changes of the reference it is reached.

    These are a factor, a turn to the left, a displacement (3,) in m, and what is added to the track's times.
    """

    distance_m: float
    across_m: float
    factor: float
    turn_rad: float
    moved_m: FloatArray
    offset_s: float


def reference_contradiction(
    track: PositionSeries, reference: ReferenceSeries, most_offset_s: float, name: str, most_gap_s: float = 0.5
) -> str | None:
    """Return why a track and a reference (called ``name``) cannot both be right, None where they can.

    ``most_offset_s`` is by how much their clocks may differ, either way; 0 where they are one. Fixes further apart
    than ``most_gap_s`` are not interpolated.
    """
    step = max(len(track) // _MOST_EPOCHS, 1)
    t_s, position = track.t_s[::step], track.position_m[::step]
    if len(t_s) < _LEAST_EPOCHS or len(reference) < 2:
        return None
    limits = (most_offset_s, most_gap_s)
    stored = _agreement(_ReferenceHypothesis(words=""), t_s, position, reference, limits)
    if stored is None:
        return None
    range_m = float(np.median(np.linalg.norm(position, axis=1)))
    variances = np.trace(track.covariance_m2[::step], axis1=1, axis2=2)
    sigma_m = float(np.sqrt(np.median(variances) + np.median(np.sum(reference.sigma_m**2, axis=1))))
    least_m = max(_LEAST_SIGMAS * sigma_m, _LEAST_M)
    near = stored.distance_m < max(_LEAST_SHARE * range_m, least_m)
    if near and stored.across_m < max(_LEAST_ACROSS_SHARE * range_m, least_m):
        return None
    tried = [(h, _agreement(h, t_s, position, reference, limits)) for h in _hypotheses()]
    known = [(h, found) for h, found in tried if found is not None and _is_told(h, found)]
    text = f"track and {name} are {stored.distance_m:.0f} m apart in the median, at ranges around {range_m:.0f} m"
    # the simplest that explains nearly as much as the best one
    best = min((found.distance_m for _, found in known), default=np.inf)
    for hypothesis, found in known:
        if found.distance_m <= min(_LEFT_SHARE * stored.distance_m, 1.5 * best + _LEAST_M):
            return f"{text}; {found.distance_m:.1f} m with {_words(hypothesis, found, name)}"
    return text


def too_few_common(track: PositionSeries, reference: ReferenceSeries, name: str, most_gap_s: float = 0.5) -> str | None:
    """Return that a track and a reference are not compared, as they have too few epochs in common; None where they are.

    What the few say is told as a fact: errors of neighbouring epochs are one, and early ones are the largest.
    """
    if not len(track):
        return None
    inside = _between_fixes(track.t_s, reference, most_gap_s)
    common = int(np.count_nonzero(inside))
    wanted = max(_LEAST_EPOCHS, (len(track) + 1) // 2)
    if common >= wanted:
        return None
    text = f"track and {name}: {common} of {len(track)} epochs tracking have a position of it at their time, "
    text += f"{wanted} are needed to judge whether both can be right{_spacing_words(reference, most_gap_s)}"
    if not common:
        return text
    there = np.stack([np.interp(track.t_s[inside], reference.t_s, column) for column in reference.position_m.T], axis=1)
    distance_m = float(np.median(np.linalg.norm(track.position_m[inside] - there, axis=1)))
    return f"{text}; there they are {distance_m:.1f} m apart in the median"


def _spacing_words(reference: ReferenceSeries, most_gap_s: float) -> str:
    """Return by how much a reference's fixes are too far apart, if most are; nothing if they are not."""
    if len(reference.t_s) < 2:
        return ""
    spacing_s = float(np.median(np.diff(reference.t_s)))
    if not is_gap(np.array(spacing_s), most_gap_s):
        return ""
    return (
        f": its fixes are {spacing_s:.3g} s apart (median), and nothing is interpolated over more than {most_gap_s:g} s"
    )


def _between_fixes(at_s: FloatArray, reference: ReferenceSeries, most_gap_s: float) -> BoolArray:
    """Return which times (n,) lie between two fixes of a reference that are at most ``most_gap_s`` apart."""
    after = np.searchsorted(reference.t_s, at_s, side="right")
    inside = np.asarray((after > 0) & (after < len(reference.t_s)))
    inside[inside] = ~is_gap(np.diff(reference.t_s), most_gap_s)[after[inside] - 1]
    return inside


def _is_told(hypothesis: _ReferenceHypothesis, found: _DistanceFit) -> bool:
    """Return whether what was fitted is more than errors of a rig or of a log are."""
    return not hypothesis.turned or abs(np.degrees(found.turn_rad)) >= _LEAST_TURN_DEG


def _hypotheses() -> Iterator[_ReferenceHypothesis]:
    """Yield the hypotheses, the simplest first."""
    axes = "xyz"
    yield _ReferenceHypothesis(words="", far=True)
    yield _ReferenceHypothesis(words="", scaled=True)
    for scaled in (False, True):
        for a, b in itertools.combinations(range(3), 2):
            order = [0, 1, 2]
            order[a], order[b] = b, a
            words = f"{axes[a]} and {axes[b]} exchanged"
            yield _ReferenceHypothesis(words=words, order=tuple(order), scaled=scaled)
        for signs in itertools.product((1.0, -1.0), repeat=3):
            reversed_ = [axes[k] for k in range(3) if signs[k] < 0.0]
            if reversed_:
                yield _ReferenceHypothesis(words=f"{' and '.join(reversed_)} reversed", signs=signs, scaled=scaled)
    for signs in itertools.product((1.0, -1.0), repeat=2):
        if min(signs) < 0.0:
            words = f"x and y exchanged and {'both' if max(signs) < 0.0 else 'one of them'} reversed"
            yield _ReferenceHypothesis(words=words, order=(1, 0, 2), signs=(*signs, 1.0))
    yield _ReferenceHypothesis(words="", turned=True)
    # last: it explains much that is short
    yield _ReferenceHypothesis(words="", displaced=True)


def _agreement(
    hypothesis: _ReferenceHypothesis,
    t_s: FloatArray,
    position: FloatArray,
    reference: ReferenceSeries,
    limits: tuple[float, float],
) -> _DistanceFit | None:
    """Return how close positions (n, 3) at ``t_s`` (n,) are to a reference under a hypothesis, at the best offset.

    ``limits`` are the largest offset and the largest gap between fixes, s.
    """
    most_offset_s, most_gap_s = limits
    path = reference.position_m[:, hypothesis.order] * np.array(hypothesis.signs)
    best: _DistanceFit | None = None
    # without enough common epochs at no offset, those at another one are of other parts of the flight
    for offset_s in _offsets(hypothesis, t_s, reference, most_offset_s):
        at_s = t_s + offset_s
        inside = _between_fixes(at_s, reference, most_gap_s)
        if np.count_nonzero(inside) < max(_LEAST_EPOCHS, 0.5 * len(t_s)):
            if offset_s == 0.0:
                return None
            continue
        there = np.stack([np.interp(at_s[inside], reference.t_s, column) for column in path.T], axis=1)
        found = _fit(hypothesis, position[inside], there, float(offset_s))
        if found.factor > 0.0 and (best is None or found.distance_m < best.distance_m):
            best = found
    return best


def _offsets(
    hypothesis: _ReferenceHypothesis, t_s: FloatArray, reference: ReferenceSeries, most_offset_s: float
) -> FloatArray:
    """Return the offsets of the clocks to try, the least first."""
    if hypothesis.displaced:
        # along a straight path a displacement is an offset
        return np.zeros(1)
    if hypothesis.far:
        low, high = reference.t_s[0] - t_s[0], reference.t_s[-1] - t_s[-1]
        step_s = max(_FAR_STEP_S, (high - low) / _MOST_FAR_STEPS)
        far = np.arange(low, high + step_s, step_s)
        far = far[np.abs(far) > most_offset_s]
        return np.asarray(far[np.argsort(np.abs(far))])
    steps = int(np.floor(most_offset_s / _OFFSET_STEP_S))
    return np.asarray(_OFFSET_STEP_S * np.array(sorted(range(-steps, steps + 1), key=abs)))


def _fit(hypothesis: _ReferenceHypothesis, mine: FloatArray, there: FloatArray, offset_s: float) -> _DistanceFit:
    """Return how close positions (n, 3) are to those (n, 3) of a reference with what a hypothesis fits."""
    factor, turn_rad, moved_m = 1.0, 0.0, np.zeros(3)
    if hypothesis.scaled:
        factor = float(np.sum(there * mine) / max(np.sum(there**2), 1e-9))
    if hypothesis.turned:
        cross = np.sum(there[:, 0] * mine[:, 1] - there[:, 1] * mine[:, 0])
        turn_rad = float(np.arctan2(cross, np.sum(there[:, :2] * mine[:, :2])))
        there = there @ rotation_z(turn_rad).T
    if hypothesis.displaced:
        moved_m = np.median(mine - there, axis=0)
    apart = mine - factor * there - moved_m
    sight = mine / np.maximum(np.linalg.norm(mine, axis=1, keepdims=True), 1e-9)
    across = apart - np.sum(apart * sight, axis=1, keepdims=True) * sight
    return _DistanceFit(
        distance_m=float(np.median(np.linalg.norm(apart, axis=1))),
        across_m=float(np.median(np.linalg.norm(across, axis=1))),
        factor=factor,
        turn_rad=turn_rad,
        moved_m=moved_m,
        offset_s=offset_s,
    )


def _words(hypothesis: _ReferenceHypothesis, found: _DistanceFit, name: str) -> str:
    changed = [f"{hypothesis.words} in {name}"] if hypothesis.words else []
    if hypothesis.far:
        way = "later" if found.offset_s < 0.0 else "earlier"
        changed.append(f"the times of {name} {abs(found.offset_s):.1f} s {way}: another clock, or leap seconds?")
    if hypothesis.turned:
        side = "left" if found.turn_rad > 0.0 else "right"
        turn_deg = abs(np.degrees(found.turn_rad))
        changed.append(f"{name} turned by {turn_deg:.1f}° to the {side}: is the azimuth of +y another?")
    if hypothesis.displaced:
        x, y, z = (round(float(by)) for by in found.moved_m)
        changed.append(f"another origin or height of {name}, which moves it by x {x:+d}, y {y:+d}, z {z:+d} m")
    if hypothesis.scaled:
        if abs(found.factor / _FOOT_M - 1.0) <= _SAME_FACTOR:
            changed.append(f"{name} taken as feet")
        elif abs(found.factor * _FOOT_M - 1.0) <= _SAME_FACTOR:
            changed.append("the track taken as feet: are the rig's positions?")
        else:
            changed.append(
                f"the track {found.factor:.3g} times as far away as {name} has it: "
                "is the rig's baseline, a focal length or a unit wrong?"
            )
    return " and ".join(changed)
