"""Which sources of a calibration a site needs for the accuracy asked for: marks, airliners, stars, a flight.

Each source leaves the stations' directions uncertain in what they share and in what they do not; range hangs on the
latter. The forecast is made again with each, positions and clocks as the site has them.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import MaskArray
from groundstation.planning.error_sources import error_sources
from groundstation.planning.forecast import Forecast, forecast, track_down
from groundstation.planning.plan_table import met_at, ranges_text
from groundstation.planning.site import Requirement, Site
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig

_AXES = ("runway_from_base.x", "runway_from_base.y", "runway_from_base.z")
_MOUNT = ("runway_from_base", "head_from_camera")


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationSource:
    """One source, or several together: ``name`` for the user, the command, what it takes, and one sigma, degrees.

    ``relative_deg`` of tilt, roll and pan of one station less another's, ``common_deg`` of their mean.
    """

    name: str
    takes: str
    relative_deg: tuple[float, float, float]
    common_deg: tuple[float, float, float]


# from docs/notes/calibration.md, in the order of their effort. Marks: six at 40 to 320 m known to 2 cm, 40 rows each of
# 0.01°, on mounts known to 0.003°; with other sources they give the heading that all stations share
SOURCES = (
    CalibrationSource(
        name="marks",
        takes="half an hour: calibrate survey",
        relative_deg=(0.0046, 0.010, 0.0044),
        common_deg=(0.0056, 0.010, 0.0038),
    ),
    CalibrationSource(
        name="marks and airliners",
        takes="five airliners and a receiver of ADS-B: calibrate sky, then survey --oriented",
        relative_deg=(0.0020, 0.010, 0.0025),
        common_deg=(0.0052, 0.010, 0.0031),
    ),
    CalibrationSource(
        name="marks and stars",
        takes="ten minutes of clear night: calibrate stars, then survey --oriented",
        relative_deg=(0.0019, 0.005, 0.0013),
        common_deg=(0.0010, 0.005, 0.0031),
    ),
    CalibrationSource(
        name="a flight with RTK",
        takes="an aircraft that may fly before: calibrate flight",
        relative_deg=(0.0006, 0.005, 0.0011),
        common_deg=(0.0030, 0.005, 0.0020),
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SourceForecast:
    """One source and the forecast of a site calibrated by it."""

    source: CalibrationSource
    site: Site
    forecast: Forecast


def source_forecasts(site: Site) -> tuple[SourceForecast, ...]:
    """Return the forecast for each source; none of a site that requires nothing or whose stations do not turn."""
    if not site.required or any(station.fixed for station in site.rig.stations):
        return ()
    sites = [replace(site, rig=calibrated_by(site.rig, source)) for source in SOURCES]
    # the track's information does not hang on the sigmas
    track = track_down(sites[0])
    names = error_sources(sites[0]).names
    return tuple(
        SourceForecast(
            source=source,
            site=one,
            forecast=forecast(one, track if error_sources(one).names == names else None),
        )
        for source, one in zip(SOURCES, sites, strict=True)
    )


def calibrated_by(rig: Rig, source: CalibrationSource) -> Rig:
    """Return the rig with a source's covariance in place of its own of base and boresight."""
    before = rig.calibration_covariance()
    rest = [k for k, name in enumerate(before.names) if not name.partition(".")[2].startswith(_MOUNT)]
    stations = [station.name for station in rig.stations]
    n = len(stations)
    names = [f"{name}.{axis}" for name in stations for axis in _AXES] + [before.names[k] for k in rest]
    matrix = np.zeros((len(names), len(names)))
    for axis in range(3):
        relative, common = math.radians(source.relative_deg[axis]), math.radians(source.common_deg[axis])
        # own errors whose difference has the one variance, and whose mean adds nothing to the other
        own = 0.5 * relative**2 * (np.eye(n) - np.full((n, n), 1.0 / n))
        places = [3 * k + axis for k in range(n)]
        matrix[np.ix_(places, places)] = own + common**2
    matrix[3 * n :, 3 * n :] = before.matrix[np.ix_(rest, rest)]
    return replace(
        rig,
        stations=tuple(replace(s, covariance_parameters=(), covariance=np.zeros((0, 0))) for s in rig.stations),
        shared_covariance=ParameterCovariance(names=tuple(names), matrix=matrix),
    )


def format_sources(site: Site, found: tuple[SourceForecast, ...]) -> str:
    """Return a line for each requirement and source, and which one is needed."""
    lines = []
    for wanted in site.required:
        reached = [(one, met_at(one.site, one.forecast, wanted)) for one in found]
        lines.append(f"{wanted.name}: {_needed(wanted, reached)}")
        lines += [f"  {one.source.name}: {_where(one, good)}" for one, good in reached]
    if lines:
        lines.append("the Moon alone leaves stations' relative pan at 0.05 deg; with marks it adds nothing to them")
    return "\n".join(["calibration that a site needs (positions and clocks as stated):", *lines]) if lines else ""


def _needed(wanted: Requirement, reached: list[tuple[SourceForecast, MaskArray]]) -> str:
    """Return the first source with which a requirement is met at as many ranges as with any."""
    most = max(int(good.sum()) for _, good in reached)
    if most == 0:
        return f"no calibration is enough for {'/'.join(f'{v:g}' for v in wanted.sigma_m)} m"
    one, good = next((one, good) for one, good in reached if int(good.sum()) == most)
    return f"{one.source.name} ({one.source.takes}), met {_where(one, good)}"


def _where(one: SourceForecast, good: MaskArray) -> str:
    if good.all():
        return "at all ranges"
    return f"at {ranges_text(one.forecast, good)}" if good.any() else "nowhere"
