"""Determined and undetermined parameters of a mount: information, fixed parameters, covariance."""

import numpy as np

from calibration.flight.problem import left_jacobian
from calibration.information import inverse, inverse_with_unobservable
from calibration.landmarks.angles import reading_variances
from calibration.mount.problem import MountProblem, PredictedSightings
from calibration.mount.standstills import with_shared_error
from calibration.robust_fit import Linearisation
from groundstation.arrays import FloatArray, MaskArray

# a parameter is determined if it is known so much better than before, and to this
_TAUGHT = 0.5
_WORST_ROTATION_RAD = float(np.radians(0.5))
BORESIGHT = tuple(f"head_from_camera.{axis}" for axis in "xyz")
BASE = tuple(f"runway_from_base.{axis}" for axis in "xyz")


def whitened(problem: MountProblem, sought: PredictedSightings, kept: MaskArray) -> Linearisation:
    """Return residuals and Jacobian of the kept sightings, in sigmas and uncorrelated."""
    seen = problem.sightings
    own = np.flatnonzero(kept)
    lasting, fleeting = reading_variances(problem.station)
    off = (sought.pixel_px - seen.pixel_px)[own, :, None]
    both = np.concatenate([off, sought.jacobian[own], sought.by_angle[own]], axis=2)
    white = (both / seen.sigma_px[own, None, None]).reshape(2 * len(own), -1)
    # errors of a reading, then of a standstill: each of rank two among the rows that share it. Of the mean of several
    # readings the first is smaller, as if the angles acted less
    averaged = np.ones(len(own)) if seen.readings is None else seen.readings[own] ** -0.5
    for number, variance, share in ((seen.pointing, fleeting, averaged), (problem.stand, lasting, None)):
        if variance > 0.0:
            acting = white[:, -2:] if share is None else white[:, -2:] * np.repeat(share, 2)[:, None]
            white = with_shared_error(white, acting, np.repeat(number[own], 2), variance)
            own = own[np.argsort(number[own], kind="stable")]
    return Linearisation(residual=white[:, 0], jacobian=white[:, 1:-2])


def information(problem: MountProblem, change: FloatArray, kept: MaskArray) -> FloatArray:
    """Return the information (p, p) of the kept sightings about the free parameters, without the prior's."""
    return whitened(problem, problem.predict(change), kept).information


def undetermined(problem: MountProblem, change: FloatArray, kept: MaskArray) -> dict[str, float]:
    """Return the parameters that are hardly better known than a priori, with their assumed sigmas.

    One after the other, the worst first: with it fixed, the others may be determined.
    """
    held: dict[str, float] = {}
    known = information(problem, change, kept)
    with np.errstate(divide="ignore"):
        known = known + np.diag(1.0 / problem.prior_sigma**2)
    free = [k for k, name in enumerate(problem.names)]
    own = [k for k, name in enumerate(problem.names) if not name.startswith(("mark ", "ptu_position"))]
    while True:
        covariance = inverse_with_unobservable(known[np.ix_(free, free)])
        worst, worst_ratio = None, 1.0
        for place, k in enumerate(free):
            if k not in own:
                continue
            limit = _TAUGHT * problem.prior_sigma[k]
            if problem.names[k] in (*BORESIGHT, *BASE):
                limit = min(limit, _WORST_ROTATION_RAD)
            ratio = float(np.sqrt(covariance[place, place])) / limit if limit < np.inf else 0.0
            if ratio > worst_ratio:
                worst, worst_ratio = k, ratio
        if worst is None:
            return held
        held[problem.names[worst]] = float(problem.prior_sigma[worst])
        free.remove(worst)


def considered(
    problem: MountProblem,
    freed: MountProblem,
    change: FloatArray,
    kept: MaskArray,
    held: dict[str, float],
    factor: float,
) -> FloatArray:
    """Return the covariance of the free parameters, with the effect of the fixed ones, and of these."""
    full = np.zeros(len(problem.names))
    places = [problem.names.index(name) for name in freed.names]
    full[places] = change
    known = factor**-2 * information(problem, full, kept)
    own = known[np.ix_(places, places)]
    with np.errstate(divide="ignore"):
        own = own + np.diag(1.0 / freed.prior_sigma**2)
    covariance = inverse(own)
    lasting = [problem.names.index(name) for name in held]
    gain = covariance @ known[np.ix_(places, lasting)]
    held_covariance = np.diag(np.square(np.array(list(held.values()), dtype=np.float64)))
    both = -gain @ held_covariance
    covariance = np.block([[covariance + gain @ held_covariance @ gain.T, both], [both.T, held_covariance]])
    turned = np.eye(len(change) + len(lasting))
    for group in (BORESIGHT, BASE):
        where = [freed.names.index(name) for name in group if name in freed.names]
        if len(where) == 3:
            turned[np.ix_(where, where)] = left_jacobian(change[where])
    return np.asarray(turned @ covariance @ turned.T)
