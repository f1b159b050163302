"""A calibrated lens put into a station of a rig: its keys replaced, its covariance, and all other keys unchanged."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.lens.model import PARAMETERS, CalibratedLens
from groundstation.errors import InputError, RigError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import PARTS, Rig
from groundstation.rig.rig_limits import size_relation
from groundstation.rig.rig_toml import rig_to_toml


def with_lens(rig: Rig, name: str, calibrated: CalibratedLens) -> Rig:
    """Return the rig with another lens of station ``name``, and its covariance.

    The old lens is removed from the station's covariance and from the shared one, with its
    correlations; all other entries stay identical. Raises `RigError` for a missing station.
    """
    before = rig[name]
    of_lens = [k for k, parameter in enumerate(before.covariance_parameters) if parameter in PARAMETERS]
    own = _without(ParameterCovariance(names=before.covariance_parameters, matrix=before.covariance), of_lens)
    known = np.flatnonzero(np.diag(calibrated.covariance) > 0.0)
    n, m = len(own.names), len(known)
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = own.matrix
    matrix[n:, n:] = calibrated.covariance[np.ix_(known, known)]
    after = replace(
        before,
        lens=calibrated.lens,
        known=tuple(part for part in PARTS if part in before.known or part == "lens"),
        covariance_parameters=(*own.names, *(PARAMETERS[k] for k in known)),
        covariance=matrix,
    )
    shared = rig.shared_covariance
    gone = [k for k, full in enumerate(shared.names) if full in {f"{name}.{parameter}" for parameter in PARAMETERS}]
    return replace(
        rig,
        stations=tuple(after if station.name == name else station for station in rig.stations),
        shared_covariance=_without(shared, gone),
    )


def _without(known: ParameterCovariance, gone: list[int]) -> ParameterCovariance:
    keep = [k for k in range(len(known.names)) if k not in gone]
    return ParameterCovariance(names=tuple(known.names[k] for k in keep), matrix=known.matrix[np.ix_(keep, keep)])


def require_station(rig: Rig, name: str) -> None:
    """Raise `RigError` where a rig has no such station."""
    if name not in rig.names:
        raise RigError(rig.path, got=f"no station {name!r}", wanted="--station with one of " + ", ".join(rig.names))


def other_size(rig: Rig, name: str, calibrated: CalibratedLens) -> str:
    """Return a doubt where a new lens is for pictures of another size than the station's so far; "" where it is not."""
    station, got = rig[name], calibrated.lens.image_size_px
    wanted = station.lens.image_size_px
    if "lens" not in station.known or got == wanted:
        return ""
    return (
        f"doubtful: got pictures of {got[0]}×{got[1]} px; wanted {wanted[0]}×{wanted[1]} px, which {name} has in"
        f" {rig.path or 'the rig'}{size_relation(got, wanted)}; recordings of that size are refused with this lens"
    )


def write_rig_with_lens(path: Path, rig: Rig, name: str, calibrated: CalibratedLens) -> None:
    """Write the rig file with that lens; raises `InputError` where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, f"# lens of {name}: new\n" + rig_to_toml(with_lens(rig, name, calibrated)))
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error
