"""The rig after a check: rotated by the estimate, with a larger covariance than before."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.joint_covariance import with_covariance
from calibration.landmarks.fit import LandmarkFit
from calibration.landmarks.problem import AXES
from calibration.landmarks.survey import floors
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig

# remaining share of uncertainty: a mount that has yielded once, or another part of it than assumed
_DOUBT = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turn:
    """The rotation: ``names`` (3) of its parameters, ``change_rad`` (3,) in the frame of their name."""

    station: str
    names: tuple[str, ...]
    change_rad: FloatArray


def corrected_rig(rig: Rig, fit: LandmarkFit, moved: Sequence[Turn], referred: set[str]) -> Rig:
    """Return the rig with the stations that have moved as they stand today, and a covariance that has grown.

    ``referred`` are the stations that were compared with a reference: theirs is a change, not a new orientation.
    """
    rig = _replaced(rig, fit, [m for m in moved if m.station not in referred])
    return _turned(rig, fit, [m for m in moved if m.station in referred])


def _turned(rig: Rig, fit: LandmarkFit, moved: Sequence[Turn]) -> Rig:
    """Return the rig rotated by the estimate against a reference; the rotation's covariance is added."""
    if not moved:
        return rig
    before = rig.calibration_covariance()
    turned = [name for m in moved for name in m.names]
    names = (*before.names, *(name for name in turned if name not in before.names))
    matrix = np.zeros((len(names), len(names)))
    matrix[: len(before.names), : len(before.names)] = before.matrix
    places = [names.index(name) for name in turned]
    by = [k for m in moved for k in fit.problem.places(f"{m.station}.moved")]
    doubt = np.diag([_doubt(m) for m in moved for _ in AXES])
    matrix[np.ix_(places, places)] += fit.covariance[np.ix_(by, by)] + doubt
    stations = list(rig.stations)
    for turn in moved:
        change = np.zeros(CALIBRATION_SIZE)
        first = fit.problem.moved_from(turn.station)
        change[first : first + 3] = turn.change_rad
        stations = [s.changed(change) if s.name == turn.station else s for s in stations]
    return with_covariance(replace(rig, stations=tuple(stations)), ParameterCovariance(names=names, matrix=matrix))


def _replaced(rig: Rig, fit: LandmarkFit, moved: Sequence[Turn]) -> Rig:
    """Return the rig with poses from the new observations, within its covariance of all but their orientation."""
    if not moved:
        return rig
    problem = fit.problem
    stations = list(rig.stations)
    names: list[str] = []
    rows: list[FloatArray] = []
    doubt: list[float] = []
    for turn in moved:
        name = turn.station
        change = problem.station_change(fit.change, name, today=True)
        stations = [s.changed(change) if s.name == name else s for s in stations]
        turned = list(turn.names)
        own = [n for n in problem.names if n.startswith(f"{name}.") and not n.startswith(f"{name}.moved.")]
        for parameter in [*turned, *(n for n in own if n not in turned)]:
            row = np.zeros(len(problem.names))
            if parameter in problem.names:
                row[problem.names.index(parameter)] = 1.0
            if parameter in turned:
                row[problem.places(f"{name}.moved")[turned.index(parameter)]] = 1.0
            names.append(parameter)
            rows.append(row)
            doubt.append(_doubt(turn) if parameter in turned else 0.0)
    gather = np.array(rows)
    matrix = gather @ fit.covariance @ gather.T + np.diag(doubt) + floors(names)
    return with_covariance(
        replace(rig, stations=tuple(stations)), ParameterCovariance(names=tuple(names), matrix=matrix)
    )


def _doubt(turn: Turn) -> float:
    """Return the variance, rad², of not knowing whether it will stay, and what exactly has turned."""
    return (_DOUBT * float(np.linalg.norm(turn.change_rad))) ** 2
