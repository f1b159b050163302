"""A joint covariance over stations put into a rig: each station's own, and one shared where stations correlate."""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station

# below this, two stations are as good as independent
_LEAST_CORRELATION = 1e-3


def with_covariance(rig: Rig, found: ParameterCovariance) -> Rig:
    """Return the rig with estimates of some parameters, ``station.parameter``; the rest keeps its values.

    Stations that are correlated, or whose clocks have a sigma, are together in the shared covariance.
    """
    before = rig.calibration_covariance()
    rest = [k for k, name in enumerate(before.names) if name not in found.names]
    names = (*found.names, *(before.names[k] for k in rest))
    n = len(found.names)
    matrix = np.zeros((len(names), len(names)))
    matrix[:n, :n] = 0.5 * (found.matrix + found.matrix.T)
    matrix[n:, n:] = before.matrix[np.ix_(rest, rest)]
    owners = [name.partition(".")[0] for name in names]
    # clocks, shutters and the DGPS have no place in a station's own table
    timed = {owners[k] for k, name in enumerate(names) if name.partition(".")[2] not in CALIBRATION_PARAMETERS}
    together = _correlated(owners, matrix) | timed
    shared = [k for k, owner in enumerate(owners) if owner in together]
    return replace(
        rig,
        stations=tuple(_with_own(s, names, matrix, set() if s.name in together else {s.name}) for s in rig.stations),
        shared_covariance=ParameterCovariance(
            names=tuple(names[k] for k in shared), matrix=matrix[np.ix_(shared, shared)]
        ),
    )


def _correlated(owners: list[str], matrix: FloatArray) -> set[str]:
    """Return the stations that correlate with another one."""
    sigma = np.sqrt(np.diag(matrix))
    scale = np.outer(sigma, sigma)
    correlation = np.abs(np.divide(matrix, scale, out=np.zeros_like(matrix), where=scale > 0.0))
    return {
        owners[i] for i, j in zip(*np.nonzero(correlation > _LEAST_CORRELATION), strict=True) if owners[i] != owners[j]
    }


def _with_own(station: Station, names: tuple[str, ...], matrix: FloatArray, owner: set[str]) -> Station:
    own = [k for k, name in enumerate(names) if name.partition(".")[0] in owner]
    return replace(
        station,
        covariance_parameters=tuple(names[k].partition(".")[2] for k in own),
        covariance=matrix[np.ix_(own, own)],
    )
