"""Parameters of a mount, their priors, and the resulting station."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.mount.covariance import BASE, BORESIGHT
from calibration.mount.fit import MountFit
from calibration.mount.problem import Mark, MarkKind
from groundstation.arrays import FloatArray
from groundstation.errors import UsageError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import PARTS, Station

LEVER = tuple(f"camera_in_head.{axis}" for axis in "xyz")
POSITION = tuple(f"ptu_position.{axis}" for axis in "xyz")
WORDS = ("boresight", "lever", "lean", "scale", "backlash", "base", "zero")
USUAL_WORDS = ("boresight", "lever", "lean", "scale", "backlash", "base")
# one sigma a priori, without other information: manufacturing tolerances of a PTU and a ruler
KNOWN_ROTATION_RAD = float(np.radians(1.0))
KNOWN_LEVER_M = 0.02
KNOWN_LEAN_RAD = float(np.radians(0.1))
KNOWN_SCALE = 1e-3
KNOWN_BACKLASH_RAD = float(np.radians(0.1))
KNOWN_ZERO_RAD = float(np.radians(1.0))
# the distance of a mark of unknown place: 50 m, times or divided by 6
UNKNOWN_DISTANCE_M = 50.0
UNKNOWN_LOG_DISTANCE = 1.8
# no hour of sightings vouches for less: mounts settle
FLOOR_ROTATION_RAD = float(np.radians(0.0002))
# angles of operation: the errors of the axes are put into the covariance by their effect here
_WORK_PAN_RAD = float(np.radians(30.0))
_WORK_TILT_RAD = float(np.radians(15.0))


def mount_words(text: str) -> tuple[str, ...]:
    """Return the words of --free, the default ones for none; raises `InputError` for an unknown one."""
    words = tuple(word.strip() for word in text.split(",") if word.strip()) or USUAL_WORDS
    for word in words:
        if word not in WORDS:
            raise UsageError("--free", got=repr(word), wanted="some of " + ", ".join(WORDS))
    return words


def choose_mount(
    station: Station, known: ParameterCovariance, marks: Sequence[Mark], words: Sequence[str]
) -> dict[str, float]:
    """Return names and prior sigmas of a station's parameters to estimate, with its marks.

    ``known`` is the covariance of the station's calibration, `Rig.station_covariance`; the priors are its marginals.
    Without a mark of known position or direction the base stays: any rotation of it is equivalent to one of the marks.
    The zeros are equivalent to the base's turn about its vertical and the boresight about the tilt axis.
    """
    rotation = KNOWN_ROTATION_RAD if "orientation" in station.known else np.inf
    stated = known.sigmas
    chosen: dict[str, float] = {}
    tied = any(mark.kind.known for mark in marks)
    zero = "zero" in words
    if "boresight" in words:
        chosen.update({name: stated.get(name) or rotation for name in BORESIGHT})
    if "base" in words and tied:
        chosen.update({name: stated.get(name) or rotation for name in BASE})
    if zero:
        for name, other in (("pan_zero", BASE[2]), ("tilt_zero", BORESIGHT[0])):
            chosen.pop(other, None)
            if name == "tilt_zero" or tied:
                chosen[name] = KNOWN_ZERO_RAD
    if "lever" in words:
        chosen.update({name: stated.get(name) or KNOWN_LEVER_M for name in LEVER})
    if "lean" in words:
        chosen["lean"] = KNOWN_LEAN_RAD
    if "scale" in words:
        chosen.update({"pan_scale": KNOWN_SCALE, "tilt_scale": KNOWN_SCALE})
    if "backlash" in words:
        chosen.update({"pan_backlash": KNOWN_BACKLASH_RAD, "tilt_backlash": KNOWN_BACKLASH_RAD})
    if any(mark.kind is MarkKind.POINT for mark in marks):
        chosen.update({name: stated[name] for name in POSITION if stated.get(name)})
    for mark in marks:
        chosen.update(_of_mark(mark))
    return chosen


def _of_mark(mark: Mark) -> dict[str, float]:
    if mark.kind is MarkKind.POINT:
        return {name: float(s) for name, s in zip(mark.names, mark.sigma, strict=True) if s > 0.0}
    if mark.kind is MarkKind.DIRECTION:
        sigma = float(np.sqrt(np.mean(mark.sigma**2)))
        return dict.fromkeys(mark.names, sigma) if sigma > 0.0 else {}
    chosen = dict.fromkeys(mark.names, np.inf)
    if mark.kind is MarkKind.UNKNOWN_POINT:
        chosen[mark.names[2]] = UNKNOWN_LOG_DISTANCE
    return chosen


def solved_station(before: Station, known: ParameterCovariance, fit: MountFit) -> Station:
    """Return the station with its estimates and its own covariance; ``known`` as in `choose_mount`.

    The rig's covariance has no names for the axes' errors: their uncertainty of pan and tilt at the angles
    of operation is added to the boresight about the head's vertical and about the tilt axis.
    """
    station = fit.problem.station_at(fit.change)
    axes = station.ptu_axes
    # gears that hardly play come out a little below none
    axes = replace(
        axes,
        pan_backlash_rad=max(axes.pan_backlash_rad, 0.0),
        tilt_backlash_rad=max(axes.tilt_backlash_rad, 0.0),
    )
    station = replace(station, ptu_axes=axes)
    names, covariance = _covariance(before, known, fit)
    oriented = "orientation" in before.known or BASE[0] in fit.problem.names
    parts = tuple(p for p in PARTS if p in before.known or (p == "orientation" and oriented))
    return replace(station, known=parts, covariance_parameters=names, covariance=covariance)


def _covariance(before: Station, known: ParameterCovariance, fit: MountFit) -> tuple[tuple[str, ...], FloatArray]:
    free = list(fit.problem.names)
    # surveyed positions stay those of the rig: their errors were only taken into account
    found = [n for n in CALIBRATION_PARAMETERS if n in free and n not in POSITION]
    kept = [k for k, name in enumerate(before.covariance_parameters) if name not in found]
    held = [n for n in fit.held if n in CALIBRATION_PARAMETERS and n not in known.names]
    size = len(found)
    total = size + len(kept) + len(held)
    covariance = np.zeros((total, total))
    places = [free.index(name) for name in found]
    covariance[:size, :size] = fit.covariance[np.ix_(places, places)]
    covariance[size : size + len(kept), size : size + len(kept)] = before.covariance[np.ix_(kept, kept)]
    for k, name in enumerate(held):
        covariance[size + len(kept) + k, size + len(kept) + k] = fit.held[name] ** 2
    names = (*found, *(before.covariance_parameters[k] for k in kept), *held)
    for k, name in enumerate(found):
        if name in (*BORESIGHT, *BASE):
            covariance[k, k] += FLOOR_ROTATION_RAD**2
    for name, variance in axis_variances(fit).items():
        # fixed parameters stay unchanged, in their covariance, too
        if name in names and name not in fit.held:
            covariance[names.index(name), names.index(name)] += variance
    return names, 0.5 * (covariance + covariance.T)


def axis_variances(fit: MountFit) -> dict[str, float]:
    """Return the variance of the boresight's pan and tilt due to the axes' errors, rad², at the angles of operation."""

    def variance(parts: dict[str, float]) -> float:
        return sum((fit.sigma(name) * effect) ** 2 for name, effect in parts.items() if name in fit.problem.names)

    pan = {"pan_scale": _WORK_PAN_RAD, "lean": np.tan(_WORK_TILT_RAD), "pan_backlash": 0.5}
    return {
        BORESIGHT[2]: variance({**pan, "pan_zero": 1.0}),
        BORESIGHT[0]: variance({"tilt_scale": _WORK_TILT_RAD, "tilt_backlash": 0.5, "tilt_zero": 1.0}),
    }
