"""Constant error sources of a site, by name: calibration parameters and clocks with their covariance."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.planning.site import Site

# the words of a plan for the parameters of a calibration; the first that fits
_WORDS = (
    ("runway_from_base.x", "mount tilt"),
    ("runway_from_base.y", "mount roll"),
    ("runway_from_base.z", "mount pan"),
    ("ptu_position", "station position"),
    ("head_from_camera", "boresight"),
    ("camera_in_head", "lever arm"),
    ("", "lens"),
)
# a station's clock is camera and PTU together; the other two are late by themselves
STATION_CLOCK, CAMERA_CLOCK, PTU_CLOCK = "station_clock", "camera_clock", "ptu_clock"
_CLOCK_WORDS = {STATION_CLOCK: "station clock", CAMERA_CLOCK: "camera clock", PTU_CLOCK: "PTU clock"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorSources:
    """The constant errors of a site: their names, covariance (m, m), and each one's ``group`` in words.

    Names are ``station.parameter`` of the calibration first, ``calibrated`` of them, then ``station.clock``.
    """

    names: tuple[str, ...]
    groups: tuple[str, ...]
    covariance: FloatArray
    calibrated: int


def error_sources(site: Site) -> ErrorSources:
    """Gather the constant errors of a site; what has no uncertainty is left out."""
    known = site.rig.calibration_covariance()
    # clocks come below, with the site's own; DGPS plays no part in a forecast
    keep = [k for k, name in enumerate(known.names) if name.partition(".")[2] in CALIBRATION_PARAMETERS]
    geometry = tuple(known.names[k] for k in keep)
    clocks = []
    for station in site.rig.stations:
        camera_s = station.camera_clock.sigma_s if station.camera_clock else 0.0
        ptu_s = 0.0 if station.fixed else station.ptu_clock.sigma_s
        for kind, sigma_s in (
            (STATION_CLOCK, site.station_clock_sigma_s),
            (CAMERA_CLOCK, camera_s),
            (PTU_CLOCK, ptu_s),
        ):
            if sigma_s > 0.0:
                clocks.append((f"{station.name}.{kind}", sigma_s))
    n = len(geometry)
    covariance = np.zeros((n + len(clocks), n + len(clocks)))
    covariance[:n, :n] = known.matrix[np.ix_(keep, keep)]
    for k, (_, sigma_s) in enumerate(clocks, start=n):
        covariance[k, k] = sigma_s**2
    names = (*geometry, *(name for name, _ in clocks))
    return ErrorSources(names=names, groups=tuple(_group(n) for n in names), covariance=covariance, calibrated=n)


def _group(name: str) -> str:
    """Return the description of ``station.parameter``."""
    parameter = name.partition(".")[2]
    if parameter in _CLOCK_WORDS:
        return _CLOCK_WORDS[parameter]
    return next(words for start, words in _WORDS if parameter.startswith(start))
