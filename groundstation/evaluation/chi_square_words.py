"""What NEES and NIS mean, in the words of the report and of the terminal; in full where they first stand."""

from typing import Any

_NEES = (
    "squared error over the stated covariance, on average: 1 when that covariance is true, less when it is too large"
)
_NIS = (
    "squared distance of the pixels from their prediction over the covariance expected, on average: 1 when that is true"
)


def describe_nees(anees: dict[str, Any], *, first: bool) -> str:
    """Return a mean NEES per dimension with the band that its sample admits; the ``first`` one with its meaning."""
    band = f"{anees['low_95']:.2f} … {anees['high_95']:.2f}"
    if not first:
        return f"ANEES {anees['mean']:.2f} (the sample admits {band})"
    return f"ANEES {anees['mean']:.2f}: {_NEES} (the sample admits {band}, if errors were independent)"


def describe_nis(nis: dict[str, Any]) -> str:
    """Return a mean NIS per degree of freedom with its meaning, the band that its sample admits, and the rejections."""
    return (
        f"NIS {nis['mean']:.2f}: {_NIS} (the sample admits {nis['low_95']:.2f} … {nis['high_95']:.2f}); "
        f"{nis['rejected']} of {nis['judged']} pixels rejected"
    )
