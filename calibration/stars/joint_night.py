"""All heads of one night together: one clock, one atmosphere, and what each relative angle hangs on.

Each head's fit is linear about its solution. Their normal equations are added, those of the clock and the refraction
once for all heads, and solved together; nothing of a head's own residuals is approximated but their curvature between
its own solution and the common one, a thousandth of a sigma.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.flight.problem import left_jacobian
from calibration.information import inverse
from calibration.mount.covariance import BASE, BORESIGHT, information
from calibration.mount.parameters import FLOOR_ROTATION_RAD
from calibration.mount.problem import MountProblem
from calibration.stars.operating_range import work_jacobian
from calibration.stars.station_night import StationNight
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance

CLOCK, REFRACTION = "mark sky.clock", "mark sky.refraction"
_BACKLASH_EFFECT = 0.5
# what is left over across and up: the boresight's turns about the head's z and x
_LEFT_TO = (BORESIGHT[2], BORESIGHT[0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointNight:
    """The common solution of s stations.

    Attributes
    ----------
    nights : each station's own fit.
    change : each station's parameters (p,), in the order of its problem's names.
    columns : each station's parameters as places in ``covariance``.
    names : of all q parameters, ``station.parameter``; the shared ones `CLOCK` and `REFRACTION`.
    covariance : (q, q), rotations as small angles about the solution.
    """

    nights: tuple[StationNight, ...]
    change: tuple[FloatArray, ...]
    columns: tuple[tuple[int, ...], ...]
    names: tuple[str, ...]
    covariance: FloatArray

    def sigma(self, name: str) -> float:
        """Return one sigma of a parameter."""
        place = self.names.index(name)
        return float(np.sqrt(self.covariance[place, place]))

    def of(self, k: int) -> FloatArray:
        """Return the covariance (p, p) of station ``k``'s own parameters."""
        return self.covariance[np.ix_(self.columns[k], self.columns[k])]


def solve_jointly(nights: Sequence[StationNight], *, station_clocks: bool = False) -> JointNight:
    """Combine the fits of one night's heads, with one clock, or with ``station_clocks`` one of each."""
    shared = (REFRACTION,) if station_clocks else (CLOCK, REFRACTION)
    names: list[str] = []
    columns = []
    for night in nights:
        own = [n if n in shared else f"{night.before.name}.{n}" for n in night.fit.problem.names]
        names += [n for n in own if n not in names]
        columns.append(tuple(names.index(n) for n in own))
    size = len(names)
    total, right, prior = np.zeros((size, size)), np.zeros(size), np.full(size, np.inf)
    for night, own_columns in zip(nights, columns, strict=True):
        fit, places = night.fit, list(own_columns)
        known = information(fit.problem, fit.change, fit.kept) / fit.noise_factor**2
        where = np.ix_(places, places)
        total[where] += known
        # at a solution the data's gradient is minus that of the priors
        right[places] += known @ fit.change + fit.change / fit.problem.prior_sigma**2
        prior[places] = fit.problem.prior_sigma
    total += np.diag(1.0 / prior**2)
    covariance = inverse(total)
    solution = covariance @ right
    turned = np.eye(size)
    change = tuple(solution[list(places)] for places in columns)
    for night, own_columns, at in zip(nights, columns, change, strict=True):
        problem_names = night.fit.problem.names
        for group in (BORESIGHT, BASE):
            rows = [problem_names.index(n) for n in group if n in problem_names]
            if len(rows) == len(group):
                block = [own_columns[k] for k in rows]
                turned[np.ix_(block, block)] = left_jacobian(at[rows])
    return JointNight(
        nights=tuple(nights),
        change=change,
        columns=tuple(columns),
        names=tuple(names),
        covariance=turned @ covariance @ turned.T,
    )


def rig_covariance(joint: JointNight) -> ParameterCovariance:
    """Return the covariance of the rig's own parameters, ``station.parameter``.

    A rig's covariance has no names for errors of the axes. What they do to the camera's direction over the angles of
    operation is given to base and boresight, by least squares, so that errors that cancel there do so in it, too; what
    no rotation describes is added to the boresights, with what stations have in common: airliners' paths that bend
    turn the axes of all heads alike. Clock and refraction are in the others' correlations.
    """
    names: list[str] = []
    rows, left = [], []
    for k, night in enumerate(joint.nights):
        problem, places = night.fit.problem, joint.columns[k]
        own = [n for n in problem.names if n in CALIBRATION_PARAMETERS]
        rotations = [n for n in own if n in (*BORESIGHT, *BASE)]
        axes = [n for n in problem.names if n not in own and not n.startswith("mark ")]
        central, aside = (small_angle_jacobian(problem, joint.change[k], part) for part in (0.0, 0.25))
        jacobian = np.concatenate([central, aside], axis=1).reshape(-1, len(problem.names))
        of_rotations = jacobian[:, [problem.names.index(n) for n in rotations]]
        of_axes = jacobian[:, [problem.names.index(n) for n in axes]]
        share = np.linalg.pinv(of_rotations, rcond=1e-6) @ of_axes
        matrix = np.zeros((len(own), len(joint.names)))
        for row, name in enumerate(own):
            matrix[row, places[problem.names.index(name)]] = 1.0
        for row, name in enumerate(rotations):
            for column, axis in enumerate(axes):
                matrix[own.index(name), places[problem.names.index(axis)]] += share[row, column]
        rows.append(matrix)
        names += [f"{night.before.name}.{n}" for n in own]
        whole = np.zeros((len(jacobian), len(joint.names)))
        whole[:, [places[problem.names.index(n)] for n in axes]] = of_axes - of_rotations @ share
        left.append(whole.reshape(-1, 2, len(joint.names)) * _senses(of_rotations, rotations)[:, None])
    mapping = np.concatenate(rows)
    covariance = mapping @ joint.covariance @ mapping.T + _leftover(joint, names, left)
    return ParameterCovariance(names=tuple(names), matrix=0.5 * (covariance + covariance.T))


def _senses(of_rotations: FloatArray, rotations: Sequence[str]) -> FloatArray:
    """Return the signs (2,) with which turns of the boresight that are given what is left over move a pixel."""
    moved = of_rotations.reshape(-1, 2, len(rotations)).mean(axis=0)
    return np.array(
        [1.0 if n not in rotations else np.sign(moved[i, rotations.index(n)]) for i, n in enumerate(_LEFT_TO)]
    )


def _leftover(joint: JointNight, names: Sequence[str], left: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance (p, p) that the rig's parameters get besides: what rotations leave, and the floor.

    ``left`` (n, 2, q) of each station: the derivatives of a direction by all parameters that no rotation describes.
    """
    found = np.zeros((len(names), len(names)))
    keys = [[f"{night.before.name}.{n}" for n in _LEFT_TO] for night in joint.nights]
    for one, of_one in zip(keys, left, strict=True):
        for other, of_other in zip(keys, left, strict=True):
            block = np.einsum("nia,ab,njb->ij", of_one, joint.covariance, of_other) / len(of_one)
            for (i, first), (j, second) in itertools.product(enumerate(one), enumerate(other)):
                if first in names and second in names:
                    found[names.index(first), names.index(second)] += block[i, j]
    for night, own in zip(joint.nights, keys, strict=True):
        for name, axis in zip(own, ("pan_backlash", "tilt_backlash"), strict=True):
            backlash = f"{night.before.name}.{axis}"
            if name in names and backlash in joint.names:
                found[names.index(name), names.index(name)] += (_BACKLASH_EFFECT * joint.sigma(backlash)) ** 2
        for n in BORESIGHT:
            if f"{night.before.name}.{n}" in names:
                place = names.index(f"{night.before.name}.{n}")
                found[place, place] += FLOOR_ROTATION_RAD**2
    return found


def small_angle_jacobian(problem: MountProblem, change: FloatArray, aside: float = 0.0) -> FloatArray:
    """Return `work_jacobian` with rotations as small angles about the solution, as covariances have them."""
    jacobian = work_jacobian(problem, change, aside)
    for group in (BORESIGHT, BASE):
        columns = [problem.names.index(n) for n in group if n in problem.names]
        if len(columns) == len(group):
            jacobian[:, :, columns] = jacobian[:, :, columns] @ np.linalg.inv(left_jacobian(change[columns]))
    return jacobian


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativeSigma:
    """One sigma of two heads' relative pan and tilt, rms over the angles of operation, degrees."""

    pan_deg: float
    tilt_deg: float


def relative_sigma(joint: JointNight, first: int, second: int) -> RelativeSigma:
    """Return how well two stations' relative directions are known."""
    difference = _directions(joint, first) - _directions(joint, second)
    variance = np.einsum("nia,ab,nib->ni", difference, joint.covariance, difference).mean(axis=0)
    pan, tilt = np.degrees(np.sqrt(variance)).tolist()
    return RelativeSigma(pan_deg=pan, tilt_deg=tilt)


def common_sigma(joint: JointNight) -> RelativeSigma:
    """Return how well the direction that all heads share is known: the mean of them, degrees."""
    mean = np.mean([_directions(joint, k) for k in range(len(joint.nights))], axis=0)
    variance = np.einsum("nia,ab,nib->ni", mean, joint.covariance, mean).mean(axis=0)
    pan, tilt = np.degrees(np.sqrt(variance)).tolist()
    return RelativeSigma(pan_deg=pan, tilt_deg=tilt)


def _directions(joint: JointNight, k: int) -> FloatArray:
    """Return the derivatives (n, 2, q) of a station's direction by all parameters, over the angles of operation."""
    jacobian = small_angle_jacobian(joint.nights[k].fit.problem, joint.change[k])
    whole = np.zeros((*jacobian.shape[:2], len(joint.names)))
    whole[:, :, list(joint.columns[k])] = jacobian
    return whole
