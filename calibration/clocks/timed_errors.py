"""Errors of clocks found by image motion: each is a difference to a camera's clock, whose error it has as well."""

from collections.abc import Collection, Mapping

import numpy as np
from scipy.linalg import block_diag

from calibration.clocks.ptu_clock_fit import TimingFit
from calibration.flight.parameters import FLOOR_CLOCK_S
from groundstation.rig.covariance import ParameterCovariance, joined
from groundstation.rig.rig import Rig


def timed_errors(rig: Rig, fits: Mapping[str, TimingFit], one_ptu_clock: bool = False) -> ParameterCovariance:
    """Return the covariance of the clocks found, of the cameras' other clocks, and of what the rig's table has, s².

    ``rig`` is the one before, ``fits`` are by station. A PTU's clock is its camera's and the fit's difference. With one
    clock of all PTUs it is known by the first camera, and each other camera's is that one less its own difference.
    """
    known = _with_cameras(rig)
    noise = np.square([max(fit.sigma_s, FLOOR_CLOCK_S) for fit in fits.values()])
    sources = (*known.names, *fits)
    found = _found(list(fits), one_ptu_clock)
    kept = [name for name in known.names if name not in found]
    weights = [{name: 1.0} for name in kept] + list(found.values())
    rows = np.array([[weight.get(source, 0.0) for source in sources] for weight in weights])
    matrix = rows @ block_diag(known.matrix, np.diag(noise)) @ rows.T
    return ParameterCovariance(names=(*kept, *found), matrix=0.5 * (matrix + matrix.T))


def shared_errors(errors: ParameterCovariance, stated: Collection[str]) -> ParameterCovariance:
    """Return the errors that a rig's table needs: those that have something in common, and all of ``stated``."""
    common = errors.matrix - np.diag(np.diag(errors.matrix))
    alone = {name for name, row in zip(errors.names, common, strict=True) if not row.any()}
    return errors.without(alone - set(stated))


def _with_cameras(rig: Rig) -> ParameterCovariance:
    """Return the rig's table, and the sigmas of the cameras' clocks that are not in it."""
    clocks = {f"{s.name}.camera_clock.offset": s.camera_clock for s in rig.stations}
    sigmas = {name: clock.sigma_s for name, clock in clocks.items() if clock is not None and clock.sigma_s > 0.0}
    matrix = np.diag(np.square(np.array(list(sigmas.values()))))
    return joined(ParameterCovariance(names=tuple(sigmas), matrix=matrix), rig.shared_covariance)


def _found(stations: list[str], one_ptu_clock: bool) -> dict[str, dict[str, float]]:
    """Return each clock found as a sum of clocks before and of fits, which have their station's name."""
    found: dict[str, dict[str, float]] = {}
    for name in stations:
        by = stations[0] if one_ptu_clock else name
        ptu = {f"{by}.camera_clock.offset": 1.0, by: 1.0}
        found[f"{name}.ptu_clock.offset"] = ptu
        if by != name:
            found[f"{name}.camera_clock.offset"] = {**ptu, name: -1.0}
    return found
