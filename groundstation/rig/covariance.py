"""Covariance of a rig's calibration: the tables of ``rig.toml``, of one station and of the whole rig.

The names are those of `groundstation.geometry.calibration.CALIBRATION_PARAMETERS`; in the table of the whole rig
they follow the station's name and a dot, which expresses errors that stations share. That table may also contain the
stations' clocks and shutters and parameters of the DGPS (`CLOCK_NAMES`, `READOUT`, `REFERENCE_NAMES`).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import RigError
from groundstation.files.toml_table import TomlTable, quoted
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.rig_limits import require_rotation_sigmas

# error of the correlations of a matrix printed with six digits
_ROUNDING = 1e-5
_MAX_PARAMETERS = 2000
# tolerance for a variance in both tables, printed with few digits
_SAME = 1e-3
CLOCK_NAMES = ("camera_clock.offset", "ptu_clock.offset")
# the rolling shutter's time, first row to last
READOUT = "readout"
REFERENCE_NAMES = ("dgps_clock.offset", *(f"dgps_antenna.{axis}" for axis in "xyz"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ParameterCovariance:
    """Names and their covariance (n, n), in rad², m², px² and products; empty without uncertain parameters."""

    names: tuple[str, ...]
    matrix: FloatArray

    @classmethod
    def nothing(cls) -> "ParameterCovariance":
        """Return the covariance of no parameter."""
        return cls(names=(), matrix=np.zeros((0, 0)))

    def without(self, names: Collection[str]) -> "ParameterCovariance":
        """Return the covariance of the parameters that are not among ``names``."""
        keep = [k for k, name in enumerate(self.names) if name not in names]
        return ParameterCovariance(names=tuple(self.names[k] for k in keep), matrix=self.matrix[np.ix_(keep, keep)])

    @property
    def sigmas(self) -> dict[str, float]:
        """One sigma of each parameter, rad, m, px; correlations left out."""
        return dict(zip(self.names, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    def of_station(self, station: str) -> "ParameterCovariance":
        """Return the marginal covariance of one station's calibration out of names ``station.parameter``.

        The names become those of a station's own table, which has none for clocks and shutters.
        """
        wanted = {f"{station}.{parameter}": parameter for parameter in CALIBRATION_PARAMETERS}
        own = [k for k, name in enumerate(self.names) if name in wanted]
        return ParameterCovariance(
            names=tuple(wanted[self.names[k]] for k in own), matrix=self.matrix[np.ix_(own, own)]
        )


def read_covariance(table: TomlTable, stations: Sequence[str] = ()) -> ParameterCovariance:
    """Read ``parameters`` and ``matrix``: symmetric, positive semi-definite, one row per known, different name.

    Parameters
    ----------
    stations : for the table of a whole rig, whose names are ``station.parameter``; none for a station's own.

    Raises
    ------
    RigError : a name is unknown or repeated, or the matrix is no covariance.
    """
    if not table.values:
        return ParameterCovariance.nothing()
    table.refuse_unknown({"parameters", "matrix"})
    names = _names(table, stations)
    rows = table.values.get("matrix", [])
    n = len(names)
    if not isinstance(rows, list) or len(rows) != n:
        raise table.fail("matrix", f"{len(rows)} rows" if isinstance(rows, list) else quoted(rows), f"{n} rows")
    matrix = np.zeros((n, n))
    for i, row in enumerate(rows):
        matrix[i] = TomlTable({"row": row}, f"{table.where}: matrix row {i + 1}", RigError).vector("row", n)
    if fault := _fault(matrix):
        raise table.fail("matrix", fault, "a covariance")
    require_rotation_sigmas(table, names, matrix)
    return ParameterCovariance(names=names, matrix=matrix)


def _names(table: TomlTable, stations: Sequence[str]) -> tuple[str, ...]:
    """Return the names of ``parameters``, every one known and none of them twice."""
    names = table.values.get("parameters", [])
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names) or len(names) > _MAX_PARAMETERS:
        raise table.fail("parameters", quoted(names), f"a list of at most {_MAX_PARAMETERS} names")
    for name in names:
        if stations and name in REFERENCE_NAMES:
            continue
        station, _, parameter = name.partition(".") if stations else ("", "", name)
        if stations and parameter in (*CLOCK_NAMES, READOUT) and station in stations:
            continue
        if stations and station not in stations:
            raise table.fail("parameters", quoted(name), "station.parameter with one of " + ", ".join(stations))
        if parameter not in CALIBRATION_PARAMETERS:
            raise table.fail("parameters", quoted(name), "one of " + ", ".join(CALIBRATION_PARAMETERS))
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise table.fail("parameters", f"{quoted(twice)} twice", "names that differ")
    return tuple(names)


def _fault(matrix: FloatArray) -> str:
    """Return why a matrix is no covariance; "" for a valid one."""
    variances = np.diag(matrix)
    if np.any(variances < 0):
        return "a negative variance"
    # judged as correlations: the parameters have different units
    sigmas = np.sqrt(variances)
    scale = np.outer(sigmas, sigmas)
    if np.any(np.abs(matrix) / (1.0 + _ROUNDING) > scale):
        return "a covariance larger than its variances allow"
    correlation = np.divide(matrix, scale, out=np.zeros_like(matrix), where=scale > 0)
    if np.any(np.abs(correlation - correlation.T) > _ROUNDING):
        return "an unsymmetric matrix"
    if len(matrix) and np.linalg.eigvalsh(correlation).min() < -_ROUNDING:
        return "a negative variance along some direction"
    return ""


def joined(own: ParameterCovariance, shared: ParameterCovariance) -> ParameterCovariance:
    """Return the parameters of both; for one in both, the variance and correlations of the shared table."""
    keep = [k for k, name in enumerate(own.names) if name not in shared.names]
    n, m = len(keep), len(shared.names)
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = own.matrix[np.ix_(keep, keep)]
    matrix[n:, n:] = shared.matrix
    return ParameterCovariance(names=(*(own.names[k] for k in keep), *shared.names), matrix=matrix)


def require_agreement(table: TomlTable, shared: ParameterCovariance, own: Mapping[str, float]) -> None:
    """Raise `RigError` if a variance of the shared table differs from ``own``, the stations' by full name."""
    for k, name in enumerate(shared.names):
        stated, given = float(shared.matrix[k, k]), own.get(name)
        if given is not None and abs(stated - given) > _SAME * max(stated, given):
            raise table.fail("covariance", f"a variance of {stated:g} for {name!r}", f"{given:g}, as its station gives")
