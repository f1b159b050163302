"""Kinds of approaches by their fault, their priors, and draws of them, natural or with larger faults and weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.landing_site.fault_table import StationFault
from integrity_approaches.fault_list import SITES
from integrity_approaches.linear_approach import DrawnFaults, LinearApproach, no_fault

NO_FAULT, TWO_AT_ONCE = "no fault", "two at once"
# two numbers that are large together need not be as large as one alone
_PAIR_POWER = 0.75
_PARAMETERS = {
    StationFault.DETECTION: 2,
    StationFault.MOUNT: 2,
    StationFault.CLOCK: 1,
    StationFault.TARGET_POINT: 3,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stratum:
    """Approaches with one kind of fault: its prior, the places of what is wrong, and whether it grows.

    ``places`` holds one tuple of hypotheses for each choice, ``chances`` how likely each of them is.
    """

    name: str
    prior: float
    places: tuple[tuple[int, ...], ...]
    chances: tuple[float, ...]
    drifting: bool = False


@cache
def approach_of(site: str) -> LinearApproach:
    """Return the approach to a site, made once in a process."""
    return LinearApproach(SITES[site])


@cache
def strata_of(site: str) -> tuple[Stratum, ...]:
    """Return all kinds of approaches of a site; their priors add up to one."""
    studied, approach = SITES[site], approach_of(site)
    found = []
    for k, h in enumerate(approach.hypotheses):
        found.append(Stratum(name=h.words(), prior=h.prior, places=((k,),), chances=(1.0,)))
        if h.fault is StationFault.MOUNT:
            name = f"{h.words()}, turning"
            found.append(
                Stratum(name=name, prior=studied.drifting_prior, places=((k,),), chances=(1.0,), drifting=True)
            )
    priors = [h.prior for h in approach.hypotheses]
    pairs = [(i, k) for i in range(len(priors)) for k in range(i)]
    products = np.array([priors[i] * priors[k] for i, k in pairs])
    both = Stratum(
        name=TWO_AT_ONCE,
        prior=float(products.sum()),
        places=tuple(pairs),
        chances=tuple((products / products.sum()).tolist()),
    )
    none = Stratum(name=NO_FAULT, prior=1.0 - sum(s.prior for s in (*found, both)), places=(), chances=())
    return (none, *found, both)


def stratum_of(site: str, name: str) -> Stratum:
    """Return a kind of approaches by its name."""
    return next(s for s in strata_of(site) if s.name == name)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WeightedFaults:
    """Faults and by how much more likely (n,) each of them is by nature than as it was drawn."""

    faults: DrawnFaults
    weights: FloatArray


def drawn(site: str, stratum: Stratum, rng: np.random.Generator, n: int, scale: float = 1.0) -> WeightedFaults:
    """Draw n approaches of a kind, by nature or, with a ``scale`` above 1, larger faults with their weights."""
    approach = approach_of(site)
    if not stratum.places:
        return WeightedFaults(faults=no_fault(n, approach.hypotheses), weights=np.ones(n))
    parameters, weights = np.zeros((n, len(approach.hypotheses), 3)), np.ones(n)
    chosen = rng.choice(len(stratum.places), size=n, p=stratum.chances)
    for choice, places in enumerate(stratum.places):
        rows = np.flatnonzero(chosen == choice)
        sizes = [_PARAMETERS[approach.hypotheses[place].fault] for place in places]
        sample = _enlarged(rng, len(rows), sum(sizes), scale)
        weights[rows] = sample.weights
        for place, size, own in zip(places, sizes, np.split(sample.values, np.cumsum(sizes)[:-1], axis=1), strict=True):
            parameters[rows, place, :size] = own
    faults = DrawnFaults(parameters=parameters, begin_s=approach.begins(rng, n), drifting=stratum.drifting)
    return WeightedFaults(faults=faults, weights=weights)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sample:
    """Values (n, d) that are standard normal if weighted by ``weights`` (n,)."""

    values: FloatArray
    weights: FloatArray


def _enlarged(rng: np.random.Generator, n: int, d: int, scale: float) -> _Sample:
    """Draw from a mixture in equal parts: each number by itself ``scale`` times as large, and each two by less.

    A rare event mostly needs one or two large numbers, and which of them is not known beforehand. Weights are those of
    the whole mixture, so that none becomes large (Owen and Zhou 2000).
    """
    pairs = list(combinations(range(d), 2))
    scales = np.ones((d + len(pairs), d))
    scales[:d][np.diag_indices(d)] = scale
    for k, pair in enumerate(pairs, start=d):
        scales[k, list(pair)] = scale**_PAIR_POWER
    values = rng.normal(size=(n, d)) * scales[rng.integers(len(scales), size=n)]
    by_part = np.exp(0.5 * (values[:, None, :] ** 2 * (1.0 - 1.0 / scales**2)).sum(axis=2)) / scales.prod(axis=1)
    return _Sample(values=values, weights=1.0 / by_part.mean(axis=1))


def shares(strata: Sequence[Stratum]) -> FloatArray:
    """Return (s,) the strata's priors as probabilities."""
    priors = np.array([s.prior for s in strata])
    return np.asarray(priors / priors.sum())
