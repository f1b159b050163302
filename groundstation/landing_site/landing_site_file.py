"""``landing-site.toml``: runway, planned approach and how it is flown, alert limits, faults (docs/formats.md)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TypeVar

from groundstation.errors import ConfigError, InputError
from groundstation.files.toml_table import TomlTable, load_toml
from groundstation.landing_site.alert_limits import AlertLimits
from groundstation.landing_site.approach_prior import ApproachPrior, WheelPosition
from groundstation.landing_site.fault_table import FaultTable
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.landing_site.runway import LandingRunway

LANDING_SITE_FORMAT = "groundstation-landing-site/1"
# Earth's largest airports fit into these; larger values indicate a wrong unit
_FAR_M, _WIDE_M, _LIMIT_M = 1e5, 200.0, 1000.0
_NO_ANGLES: Mapping[str, str] = {}
T = TypeVar("T", WheelPosition, ApproachPrior, FaultTable)


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingSite:
    """A landing site; without a file the runway of the rig's frame and the default alert limits, and no plan.

    ``wheels`` and ``prior`` are of the aircraft that lands there: where its wheels are, and how it keeps to the plan.
    ``faults`` are what the protection levels allow for.
    """

    runway: LandingRunway = field(default_factory=LandingRunway)
    approach: PlannedApproach | None = None
    alert_limits: AlertLimits = field(default_factory=AlertLimits)
    wheels: WheelPosition = field(default_factory=WheelPosition)
    prior: ApproachPrior = field(default_factory=ApproachPrior)
    faults: FaultTable = field(default_factory=FaultTable)


def load_landing_site(path: Path) -> LandingSite:
    """Read a site file. Raises `ConfigError`, naming the key, what it holds and what is wanted."""
    top = TomlTable(load_toml(path, ConfigError), str(path), ConfigError)
    top.refuse_unknown({"format", "runway", "approach", "alert_limits", "wheels", "approach_prior", "faults"})
    top.choice("format", [LANDING_SITE_FORMAT])
    return LandingSite(
        runway=_runway(top.table("runway")),
        approach=_approach(top.table("approach")) if "approach" in top else None,
        alert_limits=_alert_limits(top.table("alert_limits")),
        wheels=_numbers(WheelPosition, top.table("wheels")),
        prior=_numbers(ApproachPrior, top.table("approach_prior")),
        faults=_numbers(FaultTable, top.table("faults"), {"mount_deg": "mount_rad"}),
    )


def _runway(table: TomlTable) -> LandingRunway:
    table.refuse_unknown({"threshold_m", "direction_deg", "width_m", "length_m"})
    plain = LandingRunway()
    x, y, z = table.vector("threshold_m", 3) if "threshold_m" in table else plain.threshold_m
    for value in (x, y, z):
        if abs(value) > _FAR_M:
            raise table.fail("threshold_m", f"{value:g}", f"metres in the runway frame, at most {_FAR_M:g}")
    return LandingRunway(
        threshold_m=(float(x), float(y), float(z)),
        direction_rad=math.radians(table.number("direction_deg", 0.0, minimum=-180.0, maximum=180.0)),
        width_m=table.number("width_m", plain.width_m, above=0.0, maximum=_WIDE_M),
        length_m=table.number("length_m", above=0.0, maximum=_FAR_M) if "length_m" in table else None,
    )


def _approach(table: TomlTable) -> PlannedApproach:
    table.refuse_unknown({"glide_path_deg", "aim_past_threshold_m", "speed_m_s"})
    return PlannedApproach(
        glide_path_rad=math.radians(table.number("glide_path_deg", above=0.0, maximum=30.0)),
        aim_past_threshold_m=table.number("aim_past_threshold_m", 0.0, minimum=-_FAR_M, maximum=_FAR_M),
        speed_m_s=table.number("speed_m_s", above=0.0, maximum=300.0) if "speed_m_s" in table else None,
    )


def _alert_limits(table: TomlTable) -> AlertLimits:
    plain = AlertLimits()
    names = [f.name for f in fields(AlertLimits)]
    table.refuse_unknown(set(names))
    return AlertLimits(
        **{name: table.number(name, getattr(plain, name), above=0.0, maximum=_LIMIT_M) for name in names}
    )


def _numbers(kind: type[T], table: TomlTable, angles: Mapping[str, str] = _NO_ANGLES) -> T:
    """Return a record of numbers, each key of the table named as its field; one that is left out has its default.

    ``angles`` are keys in degrees, each with its field in radians.
    """
    plain = kind()
    table.refuse_unknown({f.name for f in fields(plain)} - set(angles.values()) | set(angles))
    values: dict[str, float | tuple[float, ...]] = {}
    for key in table.values:
        name = angles.get(key, key)
        default = getattr(plain, name)
        if isinstance(default, tuple):
            values[name] = tuple(float(v) for v in table.vector(key, len(default)))
        else:
            values[name] = math.radians(table.number(key)) if key in angles else table.number(key)
    try:
        return kind(**values)  # type: ignore[arg-type]
    except InputError as fault:
        name = fault.where.partition(": ")[2]
        key = next((key for key, of in angles.items() if of == name), name)
        raise table.fail(key, fault.got, fault.wanted) from fault
