"""The result of a combination in words: what each rig says, how they agree, what is known together."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibration.combination.directions import across_and_up, direction_jacobian, readings_of
from calibration.combination.fusion import Combination
from calibration.combination.shared_prior import stated_names
from groundstation.arrays import FloatArray
from groundstation.rig.rig import Rig, Station


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionSigma:
    """One sigma of pan and tilt, degrees, rms over the angles of operation."""

    pan_deg: float
    tilt_deg: float


def relative_direction(rig: Rig, first: str, second: str) -> DirectionSigma | None:
    """Return how well two stations' relative direction is known by a rig's covariance; None where it states no base."""
    return _direction_sigma(rig, {first: 1.0, second: -1.0})


def common_direction(rig: Rig) -> DirectionSigma | None:
    """Return how well the mean direction of all stations is known; None where a base is not stated."""
    return _direction_sigma(rig, dict.fromkeys(rig.names, 1.0 / len(rig.names)))


def _direction_sigma(rig: Rig, factors: dict[str, float]) -> DirectionSigma | None:
    covariance = direction_covariance(rig, factors)
    if covariance is None:
        return None
    pan, tilt = np.degrees(np.sqrt(np.einsum("nii->ni", covariance).mean(axis=0))).tolist()
    return DirectionSigma(pan_deg=pan, tilt_deg=tilt)


def direction_covariance(rig: Rig, factors: Mapping[str, float]) -> FloatArray | None:
    """Return the covariance (n, 2, 2), rad², of a sum of stations' directions, across and up, by the rig's own.

    One for each pair of pan and tilt of operation; ``factors`` are by station. None where a base is not stated.
    """
    names = stated_names(rig)
    known = rig.calibration_covariance()
    places = [known.names.index(name) for name in names]
    if any(f"{station}.runway_from_base.z" not in names for station in factors):
        return None
    count = min(len(readings_of(rig[station])) for station in factors)
    whole = np.zeros((count, 2, len(names)))
    for station, factor in factors.items():
        columns, jacobian = _of_station(rig[station], names)
        whole[:, :, columns] += factor * jacobian[:count]
    covariance = known.matrix[np.ix_(places, places)]
    return np.asarray(np.einsum("nik,kl,njl->nij", whole, covariance, whole))


def _of_station(station: Station, names: tuple[str, ...]) -> tuple[list[int], FloatArray]:
    """Return the places of a station's parameters and the derivatives (n, 2, k) of its directions by them."""
    columns = [k for k, name in enumerate(names) if name.startswith(f"{station.name}.")]
    readings = readings_of(station)
    jacobian = direction_jacobian(station, readings, [names[k].partition(".")[2] for k in columns])
    return columns, across_and_up(jacobian, station, readings)


def format_combination(found: Combination) -> str:
    """Return the whole report."""
    lines = [f"{'rig':<24}{'parameters':>12}{'chi-square':>12}"]
    for source, misfit in zip(found.sources, found.misfits, strict=True):
        lines.append(f"{misfit.name:<24}{misfit.parameters:>12}{misfit.chi_square:>12.1f}")
        lines += [f"  {text}" for text in _directions(source.rig)]
    if found.began is not None:
        lines.append(f"{found.sources[-1].name} is counted once: taken out of {', '.join(found.began) or 'none'}")
    lines.append(f"{'together':<24}{len(found.names):>12}{found.chi_square:>12.1f}  of {found.degrees}")
    lines += [f"  {text}" for text in _directions(found.rig)]
    if found.heading_rad is not None and found.heading_sigma_rad is not None:
        lines.append(
            f"the frame is turned by {np.degrees(found.heading_rad):+.4f} deg against what was stated of true north"
            f" (sigma {np.degrees(found.heading_sigma_rad):.4f})"
        )
    return "\n".join(lines)


def _directions(rig: Rig) -> list[str]:
    lines = []
    for first, second in combinations(rig.names, 2):
        sigma = relative_direction(rig, first, second)
        if sigma is not None:
            lines.append(
                f"{first} against {second}: {sigma.pan_deg:.4f} deg in pan, {sigma.tilt_deg:.4f} deg in tilt (1 sigma)"
            )
    common = common_direction(rig)
    if common is not None:
        lines.append(f"direction of all: {common.pan_deg:.4f} deg in pan, {common.tilt_deg:.4f} deg in tilt (1 sigma)")
    return lines or ["no station's orientation is stated"]
