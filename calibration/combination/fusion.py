"""Several calibrations of the same heads made one: each rig is a measurement of its parameters, with its covariance.

Rigs that share no data are independent. With z of each rig's parameters, as changes from the reference (the first of
them), zₖ = Eₖ x + noise of the rig's covariance Cₖ, and

    (Σ Eₖᵀ Cₖ⁻¹ Eₖ) x = Σ Eₖᵀ Cₖ⁻¹ zₖ

A rig's base and boresight go with its axes and with what it holds (a lens, a boresight): what it tells is where the
camera looks. What its axes differ in from the reference's is therefore put into its base and boresight by least
squares over the angles of operation, and in Eₖ what it holds goes with them likewise. Rigs whose azimuth is from true
north have in common that the frame of the others may be turned against it. Rigs that began with one prior count by what
their data say without it, and the prior is one more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from calibration.combination.directions import difference, direction_jacobian, directions, readings_of
from calibration.combination.shared_prior import (
    CombinationError,
    RigSource,
    began_with,
    require_independent,
    stated_covariance,
    stated_names,
    without_prior,
)
from calibration.information import inverse
from calibration.joint_covariance import with_covariance
from groundstation.arrays import FloatArray
from groundstation.errors import RigError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import PARTS, Rig, Station

_BASE = ("runway_from_base.x", "runway_from_base.y", "runway_from_base.z")
_BORESIGHT = ("head_from_camera.x", "head_from_camera.y", "head_from_camera.z")
# what a camera's direction hangs on besides base and axes
_HELD = ("head_from_camera", "focal", "principal_point", "distortion")
_ROUNDS = 3
# of directions: base and boresight are nearly the same over a narrow range
_LEAST_SINGULAR = 1e-6
# rigs that agree contradict each other so in one case of ten thousand
_CONTRADICTION = 0.9999


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceMisfit:
    """How far a source is from the combination: eᵀC⁻¹e of ``parameters`` that it states."""

    name: str
    chi_square: float
    parameters: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Combination:
    """The result.

    Attributes
    ----------
    sources : those that were combined, the prior last, if there is one. rig : with one covariance.
    began : names of the sources that began with the prior; None without one.
    names, covariance : of p parameters, ``station.parameter``, (p, p).
    misfits : of each source. chi_square, degrees : of all together.
    heading_rad : by how much the frame is turned against true north, and ``heading_sigma_rad``; None without both.
    """

    sources: tuple[RigSource, ...]
    began: tuple[str, ...] | None
    rig: Rig
    names: tuple[str, ...]
    covariance: FloatArray
    misfits: tuple[SourceMisfit, ...]
    chi_square: float
    degrees: int
    heading_rad: float | None
    heading_sigma_rad: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Measured:
    """What one source says: z (m,), E (m, q), information (m, m) and its rank; q with the heading, the last."""

    z: FloatArray
    by_state: FloatArray
    known: FloatArray
    rank: int


def combine(sources: Sequence[RigSource], heading_sigma_rad: float, prior: RigSource | None = None) -> Combination:
    """Combine rigs of the same stations; raises `RigError` and `CombinationError`.

    ``prior`` is the rig that sources began with.
    """
    _require_alike(sources, prior)
    rig = sources[0].rig
    # a heading is there to be told only where frames differ
    both = len({source.from_north for source in sources}) == 2
    began = None if prior is None else tuple(s.name for s in sources if began_with(s, prior))
    sources = (*sources, *(() if prior is None else (prior,)))
    names = _stated_by_any(sources)
    measured: list[_Measured] = []
    solution, covariance = np.zeros(len(names) + 1), np.zeros((len(names) + 1,) * 2)
    for _ in range(_ROUNDS):
        measured = [_measured(source, rig, names, None if source is prior else prior) for source in sources]
        total = sum((m.by_state.T @ m.known @ m.by_state for m in measured), np.zeros_like(covariance))
        right = sum((m.by_state.T @ m.known @ m.z for m in measured), np.zeros(len(solution)))
        total[-1, -1] += (heading_sigma_rad if both else 1e-9) ** -2
        covariance = inverse(total)
        solution = covariance @ right
        rig = _changed(rig, names, solution)
    # the last step is small: what is left over is that before it
    left = [m.z - m.by_state @ solution for m in measured]
    misfits = [float(e @ m.known @ e) for e, m in zip(left, measured, strict=True)]
    turn = (solution[-1] / heading_sigma_rad) ** 2 if both else 0.0
    degrees = sum(m.rank for m in measured) - len(names)
    _require_agreement(sources, misfits, sum(misfits) + turn, degrees)
    found = ParameterCovariance(names=names, matrix=covariance[:-1, :-1])
    return Combination(
        sources=sources,
        began=began,
        rig=with_covariance(rig, found),
        names=names,
        covariance=found.matrix,
        misfits=tuple(
            SourceMisfit(name=s.name, chi_square=value, parameters=m.rank)
            for s, value, m in zip(sources, misfits, measured, strict=True)
        ),
        chi_square=sum(misfits) + turn,
        degrees=degrees,
        heading_rad=float(solution[-1]) if both else None,
        heading_sigma_rad=float(np.sqrt(covariance[-1, -1])) if both else None,
    )


def _stated_by_any(sources: Sequence[RigSource]) -> tuple[str, ...]:
    stated = {name for source in sources for name in stated_names(source.rig)}
    stations = sources[0].rig.names
    return tuple(f"{s}.{p}" for s in stations for p in CALIBRATION_PARAMETERS if f"{s}.{p}" in stated)


def _require_alike(sources: Sequence[RigSource], prior: RigSource | None) -> None:
    if len(sources) < 2:
        raise CombinationError(f"got {len(sources)} rig; wanted two or more of the same heads")
    first = sources[0].rig
    first.require_known(("orientation", "lens"))
    if not _stated_by_any(sources):
        raise CombinationError("got rigs that state no covariance; wanted those that calibrations have written")
    for source in [*sources[1:], *([] if prior is None else [prior])]:
        if source.rig.names != first.names:
            got, wanted = (", ".join(names) for names in (source.rig.names, first.names))
            raise RigError(source.name, got=f"stations {got}", wanted=f"{wanted}, as in {sources[0].name}")
        for one, other in zip(source.rig.stations, first.stations, strict=True):
            if one.lens.image_size_px != other.lens.image_size_px or one.fixed != other.fixed:
                wanted = f"the head and camera of {sources[0].name}"
                raise RigError(source.name, got=f"another head or camera of station {one.name}", wanted=wanted)
    for source in [*sources, *([] if prior is None else [prior])]:
        if not stated_names(source.rig):
            raise RigError(source.name, got="no covariance", wanted="a rig that a calibration has written")
    require_independent(sources, prior)


def _require_agreement(sources: Sequence[RigSource], misfits: list[float], total: float, degrees: int) -> None:
    if degrees > 0 and total > float(chi2.ppf(_CONTRADICTION, degrees)):
        each = ", ".join(f"{s.name} {value:.0f}" for s, value in zip(sources, misfits, strict=True))
        raise CombinationError(
            f"got rigs that contradict each other: chi-square {total:.0f} of {degrees} ({each});"
            " wanted calibrations between which no head, camera or lens was touched"
        )


def _measured(source: RigSource, reference: Rig, names: tuple[str, ...], prior: RigSource | None) -> _Measured:
    own = [name for name in stated_names(source.rig) if name in names]
    z, by_state = np.zeros(len(own)), np.zeros((len(own), len(names) + 1))
    for row, name in enumerate(own):
        by_state[row, names.index(name)] = 1.0
        if source.from_north and name.endswith(_BASE[2]):
            by_state[row, -1] = 1.0
    for station in reference.stations:
        short = [n.partition(".")[2] for n in own if n.startswith(f"{station.name}.")]
        held = [
            n.partition(".")[2]
            for n in names
            if n.startswith(f"{station.name}.") and n not in own and n.partition(".")[2].startswith(_HELD)
        ]
        change, share = _of_station(source.rig[station.name], station, short, held)
        for k, name in enumerate(short):
            row = own.index(f"{station.name}.{name}")
            z[row] = change[k]
            for j, other in enumerate(held):
                by_state[row, names.index(f"{station.name}.{other}")] += share[k, j]
    if prior is None:
        return _Measured(z=z, by_state=by_state, known=inverse(stated_covariance(source.rig, own)), rank=len(own))
    told = without_prior(source, own, prior)
    return _Measured(z=z + told.shift, by_state=by_state, known=told.known, rank=told.rank)


def _of_station(
    station: Station, reference: Station, stated: Sequence[str], held: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the changes (k,) of what a source states, and by how much they go with what it holds, (k, h)."""
    change = np.array([difference(station, reference, name) for name in stated])
    share = np.zeros((len(stated), len(held)))
    rotations = [name for name in stated if name in (*_BASE, *_BORESIGHT)]
    if not set(_BASE) <= set(stated):
        return change, share
    readings = readings_of(reference)
    places = [stated.index(name) for name in rotations]
    of_rotations = np.linalg.pinv(direction_jacobian(reference, readings, rotations), rcond=_LEAST_SINGULAR)
    whole = np.zeros(len(CALIBRATION_PARAMETERS))
    for name, value in zip(stated, change, strict=True):
        whole[CALIBRATION_PARAMETERS.index(name)] = value
    off = directions(station, readings) - directions(reference.changed(whole), readings)
    change[places] += of_rotations @ off.ravel()
    if held:
        share[places] = of_rotations @ direction_jacobian(reference, readings, held)
    return change, share


def _changed(rig: Rig, names: tuple[str, ...], solution: FloatArray) -> Rig:
    stations = []
    for station in rig.stations:
        change = np.zeros(len(CALIBRATION_PARAMETERS))
        for name, value in zip(names, solution, strict=False):
            owner, _, short = name.partition(".")
            if owner == station.name:
                change[CALIBRATION_PARAMETERS.index(short)] = value
        known = {*station.known, *(["position"] if f"{station.name}.ptu_position.x" in names else [])}
        stations.append(replace(station.changed(change), known=tuple(p for p in PARTS if p in known)))
    return replace(rig, stations=tuple(stations))
