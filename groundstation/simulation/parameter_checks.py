"""Checks of scenario parameters; errors name the parameter, the value and the accepted values."""

import math
from collections.abc import Mapping

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import ScenarioError


def require(condition: bool, where: str, *, got: object, wanted: str) -> None:
    """Raise `ScenarioError` unless ``condition`` holds."""
    if not condition:
        raise ScenarioError(where, got=str(got), wanted=wanted)


def require_finite(where: str, value: float) -> None:
    """Raise `ScenarioError` unless a number is finite."""
    require(math.isfinite(value), where, got=value, wanted="a finite number")


def require_positive(where: str, value: float) -> None:
    """Raise `ScenarioError` unless a number is finite and > 0."""
    require(math.isfinite(value) and value > 0, where, got=value, wanted="a finite number > 0")


def require_not_negative(where: str, value: float) -> None:
    """Raise `ScenarioError` unless a number is finite and ≥ 0."""
    require(math.isfinite(value) and value >= 0, where, got=value, wanted="a finite number ≥ 0")


def require_fraction(where: str, value: float) -> None:
    """Raise `ScenarioError` unless a number is a probability."""
    require(0 <= value <= 1, where, got=value, wanted="a number from 0 to 1")


def require_within(owner: object, limits: Mapping[str, tuple[float, float]]) -> None:
    """Raise `ScenarioError` unless each of these attributes of a specification is within its limits."""
    for name, (low, high) in limits.items():
        value, where = getattr(owner, name), f"{type(owner).__name__}: {name}"
        require_finite(where, value)
        require(low <= value <= high, where, got=f"{value:g}", wanted=f"from {low:g} to {high:g}")


def require_shape(where: str, array: FloatArray, shape: tuple[int, ...]) -> None:
    """Raise `ScenarioError` unless an array has this shape and is finite."""
    require(array.shape == shape, where, got=f"shape {array.shape}", wanted=f"shape {shape}")
    require(bool(np.all(np.isfinite(array))), where, got="a number that is not finite", wanted="finite numbers")


def require_rising(where: str, t_s: FloatArray) -> None:
    """Raise `ScenarioError` unless times (n,) are finite and each is later than the one before."""
    require_shape(where, t_s, (t_s.size,))
    steps = np.diff(t_s)
    late = int(np.argmin(steps)) + 1 if steps.size else 0
    require(steps.size > 0, where, got=f"{t_s.size} times", wanted="two or more")
    require(bool(steps.min() > 0), f"{where}[{late}]", got=f"{t_s[late]:.9g}", wanted=f"later than {t_s[late - 1]:.9g}")
