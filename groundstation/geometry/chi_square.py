"""Quantiles of the χ² distribution, as `scipy.stats.chi2` has them to the last bit.

That package takes 0.3 s of a core to import, in every process of a station, and a call of it 100 times as long.
"""

from typing import Any

from numpy.typing import ArrayLike
from scipy.special import chdtri, gammaincinv


def chi_square_quantile(probability: ArrayLike, dof: Any) -> Any:
    """Return what χ² with ``dof`` degrees of freedom stays below with this probability; of a number or an array."""
    return 2.0 * gammaincinv(dof / 2.0, probability)


def chi_square_limit(chance: ArrayLike, dof: Any) -> Any:
    """Return what χ² with ``dof`` degrees of freedom exceeds with this chance, exact for small ones too."""
    return chdtri(dof, chance)
