"""All heads of one night together: one clock, one atmosphere, and what each relative angle hangs on.

Each head's fit is linear about its solution. Their normal equations are added, those of the clock and the refraction
once for all heads, and solved together; nothing of a head's own residuals is approximated but their curvature between
its own solution and the common one, a thousandth of a sigma.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.flight.problem import left_jacobian
from calibration.information import inverse
from calibration.mount.covariance import BASE, BORESIGHT, information
from calibration.mount.parameters import FLOOR_ROTATION_RAD
from calibration.stars.operating_range import work_jacobian
from calibration.stars.station_night import StationNight
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance

CLOCK, REFRACTION = "mark sky.clock", "mark sky.refraction"
_BACKLASH_EFFECT = 0.5


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
    no rotation describes is added to the boresight. Clock and refraction are in the others' correlations.
    """
    names: list[str] = []
    rows = []
    extra: list[float] = []
    for k, night in enumerate(joint.nights):
        problem, places = night.fit.problem, joint.columns[k]
        own = [n for n in problem.names if n in CALIBRATION_PARAMETERS]
        rotations = [n for n in own if n in (*BORESIGHT, *BASE)]
        axes = [n for n in problem.names if n not in own and not n.startswith("mark ")]
        central, aside = (work_jacobian(problem, joint.change[k], part) for part in (0.0, 0.25))
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
        extra += _leftover(joint, k, own, axes, of_axes - of_rotations @ share)
    whole = np.concatenate(rows)
    covariance = whole @ joint.covariance @ whole.T + np.diag(extra)
    return ParameterCovariance(names=tuple(names), matrix=0.5 * (covariance + covariance.T))


def _leftover(joint: JointNight, k: int, own: Sequence[str], axes: Sequence[str], left: FloatArray) -> list[float]:
    """Return the variances that a station's parameters get besides: what rotations do not describe, and the floor."""
    problem, places = joint.nights[k].fit.problem, joint.columns[k]
    columns = [places[problem.names.index(n)] for n in axes]
    variance = np.einsum("na,ab,nb->n", left, joint.covariance[np.ix_(columns, columns)], left).reshape(-1, 2)
    across, up = variance.mean(axis=0).tolist()
    by_axis = {BORESIGHT[2]: across, BORESIGHT[0]: up}
    for name, axis in ((BORESIGHT[2], "pan_backlash"), (BORESIGHT[0], "tilt_backlash")):
        if axis in axes:
            place = places[problem.names.index(axis)]
            by_axis[name] += _BACKLASH_EFFECT**2 * float(joint.covariance[place, place])
    floor = FLOOR_ROTATION_RAD**2
    return [by_axis.get(n, 0.0) + (floor if n in BORESIGHT else 0.0) for n in own]


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
    jacobian = work_jacobian(joint.nights[k].fit.problem, joint.change[k])
    whole = np.zeros((*jacobian.shape[:2], len(joint.names)))
    whole[:, :, list(joint.columns[k])] = jacobian
    return whole
