"""What several rigs knew before they were calibrated, counted once; and rigs that would count twice.

A rig that began with a prior of covariance P and states C afterwards has of its own data the information C⁻¹ − P⁻¹.
With C = G Gᵀ and M = Gᵀ P⁻¹ G, whose eigenvalues are 1 where the data tell nothing, that is G⁻ᵀ (I − M) G⁻¹, and what
the data alone say lies by −G (I − M)⁺ Gᵀ P⁻¹ δ from the rig, δ from the rig to the prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibration.combination.directions import difference
from calibration.information import inverse
from groundstation.arrays import FloatArray
from groundstation.errors import GroundstationError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.rig import Rig

# digits of a rig file
_SAME, _EQUAL = 1e-6, 1e-9
# a rig states no more than it knew before but for so much, and its data tell something from so much on
_NO_MORE, _LEAST_TOLD = 1e-3, 1e-4


class CombinationError(GroundstationError):
    """Rigs that cannot be made one: they state nothing, are not independent, or contradict each other."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigSource:
    """One calibration: its ``name`` for the user, the rig, and whether its azimuth is from true north."""

    name: str
    rig: Rig
    from_north: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnInformation:
    """What the data of a rig say, without a prior: information (m, m), shift (m,) of its parameters, and its rank."""

    known: FloatArray
    shift: FloatArray
    rank: int


def stated_names(rig: Rig) -> tuple[str, ...]:
    """Return the parameters, ``station.parameter``, of which a rig states how well they are known."""
    known = rig.calibration_covariance()
    return tuple(
        name
        for k, name in enumerate(known.names)
        if name.partition(".")[2] in CALIBRATION_PARAMETERS and known.matrix[k, k] > 0.0
    )


def stated_covariance(rig: Rig, names: Sequence[str]) -> FloatArray:
    """Return what a rig states of parameters, (n, n)."""
    stated = rig.calibration_covariance()
    rows = [stated.names.index(name) for name in names]
    return stated.matrix[np.ix_(rows, rows)]


def change_between(rig: Rig, other: Rig, names: Sequence[str]) -> FloatArray:
    """Return by how much parameters (n,) of another rig differ from those of a rig."""
    found = []
    for name in names:
        station, _, short = name.partition(".")
        found.append(difference(other[station], rig[station], short))
    return np.array(found)


def require_independent(sources: Sequence[RigSource], prior: RigSource | None) -> None:
    """Raise `CombinationError` for a rig given twice, and for rigs that share what was known before without a prior."""
    for one, other in combinations([*sources, *([] if prior is None else [prior])], 2):
        names = stated_names(one.rig)
        alike = names == stated_names(other.rig) and _alike(one.rig, other.rig, names)
        if alike and not np.any(np.abs(change_between(one.rig, other.rig, names)) > _EQUAL):
            raise CombinationError(
                f"{other.name}: got the calibration of {one.name} once more;"
                " wanted each once: what is given twice would count twice"
            )
    if prior is not None:
        return
    for one, other in combinations(sources, 2):
        for group, names in _groups(stated_names(one.rig)).items():
            if names == _groups(stated_names(other.rig)).get(group) and _alike(one.rig, other.rig, names):
                raise CombinationError(
                    f"{one.name}, {other.name}: got one and the same covariance of {group} in both, as known before;"
                    " wanted --prior RIG, the rig that both began with, so that it counts once"
                )


def began_with(source: RigSource, prior: RigSource) -> tuple[str, ...]:
    """Return of which of the prior's parameters a rig states no more than the prior: those that it began with."""
    shared = [name for name in stated_names(source.rig) if name in stated_names(prior.rig)]
    names = tuple(n for own in _groups(shared).values() if _excess(source.rig, prior.rig, own) <= _NO_MORE for n in own)
    if names and _excess(source.rig, prior.rig, names) > _NO_MORE:
        raise CombinationError(
            f"{source.name}: got a covariance that {prior.name} cannot be taken out of;"
            " wanted a rig that was calibrated from it, or none of its parts"
        )
    return names


def without_prior(source: RigSource, own: Sequence[str], prior: RigSource) -> OwnInformation:
    """Return what the data of a rig say of the parameters that it states, without the prior that it began with."""
    covariance = stated_covariance(source.rig, own)
    names = began_with(source, prior)
    if not names:
        return OwnInformation(known=inverse(covariance), shift=np.zeros(len(own)), rank=len(own))
    sigma = np.sqrt(np.diag(covariance))
    eigenvalues, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    half = sigma[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 1e-15))
    rows = [own.index(name) for name in names]
    before = np.zeros_like(covariance)
    before[np.ix_(rows, rows)] = inverse(stated_covariance(prior.rig, names))
    to_prior = np.zeros(len(own))
    to_prior[rows] = change_between(source.rig, prior.rig, names)
    told, axes = np.linalg.eigh(np.eye(len(own)) - half.T @ before @ half)
    tells = told > _LEAST_TOLD
    back = np.linalg.inv(half).T @ axes[:, tells]
    forth = half @ axes[:, tells]
    return OwnInformation(
        known=back * told[tells] @ back.T,
        shift=-(forth / told[tells]) @ (forth.T @ (before @ to_prior)),
        rank=int(tells.sum()),
    )


def _alike(one: Rig, other: Rig, names: Sequence[str]) -> bool:
    here, there = (stated_covariance(rig, names) for rig in (one, other))
    sigma = np.sqrt(np.diag(here))
    return bool(np.all(np.abs(here - there) <= _SAME * np.outer(sigma, sigma)))


def _excess(rig: Rig, prior: Rig, names: Sequence[str]) -> float:
    """Return by which share at most a rig's variance of any combination of parameters is above the prior's."""
    here, before = (stated_covariance(one, names) for one in (rig, prior))
    sigma = np.sqrt(np.diag(before))
    scale = np.outer(sigma, sigma)
    half = np.linalg.cholesky(before / scale + 1e-12 * np.eye(len(names)))
    within = np.linalg.solve(half, np.linalg.solve(half, here / scale).T)
    return float(np.linalg.eigvalsh(0.5 * (within + within.T)).max()) - 1.0


def _groups(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return parameters by ``station.group``."""
    found: dict[str, tuple[str, ...]] = {}
    for name in names:
        group = name.rpartition(".")[0]
        found[group] = (*found.get(group, ()), name)
    return found
