"""The elements of the inverse of a banded positive definite matrix within its band, from its Cholesky factor.

An inverse is full, but the covariance of each difference of a path needs only the elements within the band. From
Z L = L⁻ᵀ, whose part below the diagonal is zero, Z_ij = (δ_ij / L_jj − Σ_{k>j} Z_ik L_kj) / L_jj from the last column
to the first, which stays within the band (K. Takahashi, J. Fagan and M.-S. Chin, 8th PICA conference, 1973).
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray


@njit(cache=True)
def banded_inverse(root: FloatArray) -> FloatArray:
    """Return the lower bands (b + 1, n) of N⁻¹.

    Parameters
    ----------
    root : lower bands (b + 1, n) of L with N = L Lᵀ, as `scipy.linalg.cholesky_banded` gives them with ``lower``.
    """
    width, n = root.shape[0] - 1, root.shape[1]
    Z = np.zeros(root.shape)
    for j in range(n - 1, -1, -1):
        last = min(j + width, n - 1)
        for i in range(last, j - 1, -1):
            total = 1.0 / root[0, j] if i == j else 0.0
            for k in range(j + 1, last + 1):
                total -= Z[abs(i - k), min(i, k)] * root[k - j, j]
            Z[i - j, j] = total / root[0, j]
    return Z
