"""The faults of the study, fixed beforehand, and the sites that they are put into.

A fault begins at a time that is uniform over the approach (or before it: a third of them) and lasts to its end. Sizes
are normal, one sigma as in `FaultTable`; all priors are per approach.

| fault | prior | size (one sigma) | part of the level's hypotheses |
|---|---|---|---|
| detection of a station | 1e-3 each | 0.1 span, any direction of the picture | yes |
| mount of a station | 1e-3 each, 1e-4 after a pre-flight check | 0.05° of pan and of tilt | yes |
| clock of a station | 1e-4 each | 50 ms | yes |
| target point | 1e-3 | 0.25, 0.1, 0.05 spans along, right, up | yes |
| mount that goes on turning | 1e-4 each, 1e-5 after a check | 0.05° within 10 s | no: constant is supposed |
| two of them at once | products of the priors | as above | no: part of the risk |
"""

from dataclasses import dataclass, replace

import numpy as np

from groundstation.integrity.protection_levels import ProtectionConfig
from groundstation.landing_site.fault_table import FaultTable
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.runway import LandingRunway
from groundstation.rig.rig import ClockModel, Rig, Station
from groundstation.simulation.standard_cases import STEP_RAD, standard_rig

SPAN_M = 2.3
# stands on the planned path's aim point: heights over the threshold are those over the runway
SITE = LandingSite(runway=LandingRunway(threshold_m=(0.0, 60.0, 0.0)))
# what a calibration on a flight leaves of pan and tilt (docs/notes/calibration.md), and a good clock
MOUNT_SIGMA_RAD, CLOCK_SIGMA_S = float(np.radians(0.005)), 0.002
DRIFT_S = 10.0
CHECKED_MOUNT_PRIOR = 1e-4
# of the priors of a mount that stands still
DRIFTING_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class StudiedSite:
    """A rig and what is supposed of its faults."""

    name: str
    rig: Rig
    config: ProtectionConfig

    @property
    def drifting_prior(self) -> float:
        """Prior of a mount that goes on turning, each station."""
        return DRIFTING_SHARE * self.config.faults.mount_prior


def _calibrated(station: Station) -> Station:
    names = ("runway_from_base.x", "runway_from_base.z")
    spread = np.eye(2) * MOUNT_SIGMA_RAD**2
    clock = ClockModel(sigma_s=CLOCK_SIGMA_S)
    return replace(station, covariance_parameters=names, covariance=spread, ptu_clock=clock)


def _rig(*, third: bool) -> Rig:
    plain = standard_rig(third=third, resolution_rad=0.0, sigma_rad=STEP_RAD / 12**0.5)
    return replace(plain, stations=tuple(_calibrated(s) for s in plain.stations))


def _site(name: str, *, third: bool, checked: bool) -> StudiedSite:
    table = FaultTable(mount_prior=CHECKED_MOUNT_PRIOR) if checked else FaultTable()
    return StudiedSite(name=name, rig=_rig(third=third), config=ProtectionConfig(faults=table))


SITES = {
    site.name: site
    for site in (
        _site("two stations", third=False, checked=False),
        _site("two stations, pre-flight check", third=False, checked=True),
        _site("three stations", third=True, checked=False),
        _site("three stations, pre-flight check", third=True, checked=True),
    )
}
