"""The faults that a protection level allows for: how likely each is in one approach, and how large.

The numbers are assumptions, stated before any flight and the same for all (docs/integrity.md gives their reasons). A
size is one sigma of a normal distribution: a fault of any size can happen, larger ones less often. What the residuals
see of a fault does not depend on its size; what they do not see enters the protection level with it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np
from scipy.special import ndtri

from groundstation.arrays import FloatArray
from groundstation.errors import ConfigError

_WHERE = "fault table"
# a factor of 8 in standard deviations is 1e-15: more is no probability that anyone can state
_LEAST_RISK = 1e-12


class StationFault(StrEnum):
    """What can be wrong: at one station, or with the point that all of them track."""

    DETECTION = "detection"
    MOUNT = "mount"
    CLOCK = "clock"
    TARGET_POINT = "target point"


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultHypothesis:
    """A fault and the station that has it; ``station`` is empty for the target point, which all have in common."""

    fault: StationFault
    station: str
    prior: float

    def words(self) -> str:
        """Return the fault in words."""
        return f"{self.fault} of station {self.station}" if self.station else str(self.fault)


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultTable:
    """Priors per approach, sizes (one sigma) and the risk that may be left.

    Attributes
    ----------
    detection_prior, detection_spans : one camera reports another point of the picture than the nose for longer than the
        time to alert; in any direction of the picture, in spans of the aircraft.
    mount_prior, mount_rad : a station is turned against its calibration, about its pan and its tilt axis.
    clock_prior, clock_s : pictures and readings of a station no longer belong to their stamps.
    target_point_prior, target_point_spans : all cameras report another point of the aircraft than its nose: along,
        right of and above the direction of landing, in spans.
    risk : probability of misleading information that may be left in one approach, all axes and faults together.
    exposures : number of independent errors of the fault-free filter in one approach.
    false_alarms : probability of a false alarm of the residual test in one approach.
    """

    detection_prior: float = 1e-3
    detection_spans: float = 0.1
    mount_prior: float = 1e-3
    mount_rad: float = math.radians(0.05)
    clock_prior: float = 1e-4
    clock_s: float = 0.05
    target_point_prior: float = 1e-3
    target_point_spans: tuple[float, float, float] = (0.25, 0.1, 0.05)
    risk: float = 1e-4
    exposures: float = 20.0
    false_alarms: float = 1e-3

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            shares = item.name.endswith("prior") or item.name in ("risk", "false_alarms")
            least, most = (0.0, 0.5) if shares else (0.0, 1e6)
            least = _LEAST_RISK if item.name in ("risk", "false_alarms") else least
            for number in value if isinstance(value, tuple) else (value,):
                # written so that NaN is none of them
                if not (least <= number <= most and (number > 0 or item.name.endswith("prior"))):
                    raise ConfigError(
                        f"{_WHERE}: {item.name}", got=f"{number:g}", wanted=f"a number above 0 and up to {most:g}"
                    )

    def hypotheses(self, stations: Sequence[str]) -> tuple[FaultHypothesis, ...]:
        """Return the faults of one approach, each station's and the target point's."""
        kinds = (
            (StationFault.DETECTION, self.detection_prior),
            (StationFault.MOUNT, self.mount_prior),
            (StationFault.CLOCK, self.clock_prior),
        )
        found = [FaultHypothesis(fault=kind, station=name, prior=p) for name in stations for kind, p in kinds]
        common = FaultHypothesis(fault=StationFault.TARGET_POINT, station="", prior=self.target_point_prior)
        return (*found, common)

    def two_at_once(self, stations: Sequence[str]) -> float:
        """Return the probability that two of the faults fall into one approach: it is not protected against."""
        priors = np.array([h.prior for h in self.hypotheses(stations)])
        return 0.5 * float(priors.sum() ** 2 - (priors**2).sum())

    def allocation(self, stations: Sequence[str]) -> "RiskAllocation":
        """Divide the risk among axes and hypotheses; raises `ConfigError` where two faults at once exceed it.

        What two simultaneous faults leave is divided equally by three axes and then by all hypotheses, the fault-free
        one among them (Blanch et al. 2015, section III, with equal shares in place of a search for the best ones).
        """
        hypotheses = self.hypotheses(stations)
        left = self.risk - self.two_at_once(stations)
        if left <= 0.0:
            wanted = (
                f"more than {self.two_at_once(stations):.2g}, the probability of two faults in one approach with "
                f"{len(stations)} stations; or smaller priors, in [faults] of the landing site's file"
            )
            raise ConfigError(f"{_WHERE}: risk", got=f"{self.risk:g}", wanted=wanted)
        share = left / 3.0 / (len(hypotheses) + 1)
        priors = np.array([h.prior for h in hypotheses])
        allowed = np.minimum(share / np.maximum(priors, 1e-300), 1.0)
        tests = 3.0 * len(hypotheses) * 2.0 * self.exposures
        return RiskAllocation(
            hypotheses=hypotheses,
            fault_free=two_sided_quantile(share / self.exposures),
            faulty=np.array([two_sided_quantile(float(a)) for a in allowed]),
            monitored=allowed < 1.0,
            alarm=two_sided_quantile(self.false_alarms / tests),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RiskAllocation:
    """Factors of the sigmas that the risk leads to.

    Attributes
    ----------
    hypotheses : the F faults.
    fault_free : factor of the fault-free sigma.
    faulty : (F,) factors of the sigmas given each fault.
    monitored : (F,) whether a fault is likelier than its share of the risk; one that is not needs no protection.
    alarm : factor of the sigma of a separation at which the test alarms.
    """

    hypotheses: tuple[FaultHypothesis, ...]
    fault_free: float
    faulty: FloatArray
    monitored: FloatArray
    alarm: float


def two_sided_quantile(chance: float) -> float:
    """Return how many sigmas a normal error exceeds, either way, with a chance."""
    return float(-ndtri(0.5 * chance))
