"""One run as it goes into a comparison: its track over time, the references at the same times, and the errors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.evaluation.position_series import BoolArray

POSITION_DOF = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackSeries:
    """The n rows of a track, in the session's frame.

    Attributes
    ----------
    t_s : (n,) rising, session time.
    status : (n,) words of `track.csv`.
    position_m : (n, 3); not a number without an estimate.
    covariance_m2 : (n, 3, 3) of the position; not a number without an estimate, or where it cannot be inverted.
    """

    t_s: FloatArray
    status: NDArray[np.str_]
    position_m: FloatArray
    covariance_m2: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def known(self) -> BoolArray:
        """Return which rows (n,) have an estimate."""
        return np.asarray(np.isfinite(self.position_m).all(axis=1))

    @property
    def sigma_m(self) -> FloatArray:
        """Return the stated sigma of each axis, (n, 3)."""
        return np.sqrt(np.einsum("nii->ni", self.covariance_m2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorSeries:
    """The errors of a track of n rows against one reference; not a number where either has no position.

    Attributes
    ----------
    t_s : (n,) session time.
    range_m : (n,) the reference's y.
    error_m : (n, 3) estimate minus reference.
    covariance_m2 : (n, 3, 3) of the error: the track's, with the reference's own noise added.
    """

    t_s: FloatArray
    range_m: FloatArray
    error_m: FloatArray
    covariance_m2: FloatArray

    @property
    def known(self) -> BoolArray:
        """Return at which rows (n,) there is an error."""
        return np.asarray(np.isfinite(self.error_m).all(axis=1))

    @property
    def distance_m(self) -> FloatArray:
        """Return the size of the error in 3-D, (n,)."""
        return np.asarray(np.linalg.norm(self.error_m, axis=1))

    @property
    def sigma_m(self) -> FloatArray:
        """Return the stated sigma of the error in each axis, (n, 3)."""
        return np.sqrt(np.einsum("nii->ni", self.covariance_m2))

    def nees(self) -> FloatArray:
        """Return the normalised estimation error squared, (n,), per degree of freedom."""
        whole = self.known & np.isfinite(self.covariance_m2).all(axis=(1, 2))
        found = np.full(len(self.t_s), np.nan)
        e, P = self.error_m[whole], self.covariance_m2[whole]
        found[whole] = np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]) / POSITION_DOF
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferencePositions:
    """A reference at the n rows of a track: ``position_m`` (n, 3), not a number where unusable; ``sigma_m`` (3,)."""

    position_m: FloatArray
    sigma_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunSeries:
    """A run: its name, its track, and by name ("truth", "dgps") the references at the track's rows."""

    name: str
    track: TrackSeries
    references: Mapping[str, ReferencePositions]

    def errors(self, reference: str) -> ErrorSeries | None:
        """Return the errors against a reference; None where the run has none of them."""
        at = self.references.get(reference)
        if at is None:
            return None
        found = ErrorSeries(
            t_s=self.track.t_s,
            range_m=at.position_m[:, 1],
            error_m=self.track.position_m - at.position_m,
            covariance_m2=self.track.covariance_m2 + np.diag(at.sigma_m**2),
        )
        return found if found.known.any() else None


def invertible(covariance_m2: FloatArray) -> FloatArray:
    """Return covariances (n, 3, 3); not a number in place of one that is not finite or not positive definite."""
    finite = np.asarray(np.isfinite(covariance_m2).all(axis=(1, 2)))
    least = np.asarray(np.linalg.eigvalsh(np.where(finite[:, None, None], covariance_m2, 0.0)))[:, 0]
    return np.where((least > 0.0)[:, None, None], covariance_m2, np.nan)
