"""Drivers for serial pan-tilt units, usable without the rest: `open_ptu(url)`, and the interface of a unit."""

from ptu_drivers.errors import (
    LimitError,
    LineError,
    MissingPackageError,
    NoAnswerError,
    ProtocolError,
    PtuError,
    RefusedError,
    UnsupportedError,
)
from ptu_drivers.health import FailureReason, Health, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.lease import Lease, LeaseKind
from ptu_drivers.messages import (
    AngleSample,
    AngleSource,
    Axis,
    AxisDescription,
    Capability,
    NoReading,
    Reading,
    UnitDescription,
)
from ptu_drivers.open import PROTOCOLS, open_ptu
from ptu_drivers.settings import AxisSettings, UnitSettings

__all__ = [
    "PROTOCOLS",
    "AngleSample",
    "AngleSource",
    "Axis",
    "AxisDescription",
    "AxisSettings",
    "Capability",
    "FailureReason",
    "Health",
    "Lease",
    "LeaseKind",
    "LimitError",
    "LineError",
    "MissingPackageError",
    "NoAnswerError",
    "NoReading",
    "PanTiltUnit",
    "ProtocolError",
    "PtuError",
    "Reading",
    "RefusedError",
    "UnitDescription",
    "UnitSettings",
    "UnitState",
    "UnsupportedError",
    "open_ptu",
]
