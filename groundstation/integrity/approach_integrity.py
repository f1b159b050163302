"""Integrity of an approach: reports of the pipeline and time in, advice and log events out."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from groundstation.errors import InputError
from groundstation.integrity.approach_advice import (
    AdviceConfig,
    AdviceLevel,
    AdviceRules,
    ApproachAdvice,
    Situation,
)
from groundstation.integrity.fault_geometry import StationLook
from groundstation.integrity.protection_levels import ProtectionConfig, ProtectionLevelMonitor, ProtectionLevels
from groundstation.landing_site.fault_table import FaultTable
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Kinematics,
    Miss,
    MissReason,
    StepReport,
    TrackEstimate,
    TrackEvent,
    TrackStatus,
)
from groundstation.rig.rig import Rig

# pairs whose looks are kept until their estimate comes: some seconds at any frame rate
_MOST_PAIRS = 256
_WITHOUT_TARGET = (TrackStatus.SEARCHING, TrackStatus.ACQUIRING, TrackStatus.LOST)
# the station sees nothing in such a frame, whatever is there
_BLIND = (MissReason.NO_PTU_ANGLE, MissReason.LATE, MissReason.DETECTION_FAILED, MissReason.OTHER_PICTURE_SIZE)


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachIntegrityConfig:
    """Tuning of the protection levels and of the advice."""

    protection: ProtectionConfig = field(default_factory=ProtectionConfig)
    advice: AdviceConfig = field(default_factory=AdviceConfig)


class ApproachIntegrity:
    """GO, CAUTION or WAVE-OFF of the approach that a pipeline tracks.

    It is to be fed all reports of the pipeline with the session's time, and told the time where there are none: in
    operation by the heartbeats' reports (`TrackState`) or by `pass_time`. Without either an advice ends at its
    ``valid_until_s``.

    Parameters
    ----------
    rig : as the pipeline has it.
    site : runway and alert limits; without a ``config`` the faults, too.
    span_m : the aircraft's wing span.
    """

    def __init__(
        self, rig: Rig, site: LandingSite, config: ApproachIntegrityConfig | None = None, *, span_m: float = 2.3
    ) -> None:
        if config is None:
            # a fault has to fill the window within the time to alert, or the levels do not hold by then
            window_s = min(ProtectionConfig().window_s, site.alert_limits.time_to_alert_s)
            config = ApproachIntegrityConfig(protection=ProtectionConfig(faults=site.faults, window_s=window_s))
        self._runway, self._limits = site.runway, site.alert_limits
        self._levels = ProtectionLevelMonitor(rig, site.runway, config.protection, span_m=span_m)
        self._rules = AdviceRules(site.alert_limits, config.advice)
        self._looks: dict[int, dict[str, StationLook]] = {}
        self._names = rig.names
        self._stations: dict[str, CameraReport] = {}
        self._delivers_from_s = math.inf
        self._now_s = -math.inf
        self._estimate_s = self._pair_s = self._fault_s = -math.inf
        self._status, self._fault = TrackStatus.SEARCHING, ""
        self._found: ProtectionLevels | None = None
        self._height_m: float | None = None
        self._sink_m_s = 0.0
        self._told: tuple[AdviceLevel, str] | None = None
        self._advice: ApproachAdvice | None = None

    @property
    def faults(self) -> FaultTable:
        """What the protection levels allow for."""
        return self._levels.config.faults

    @property
    def advice(self) -> ApproachAdvice | None:
        """The last advice, valid until its ``valid_until_s``; None before the first time."""
        return self._advice

    def take(self, report: StepReport, now_s: float) -> tuple[TrackEvent, ...]:
        """Take a report that the pipeline gave at session time ``now_s``; return an event if the advice changes."""
        self._advance(now_s)
        for state in report.states:
            self._advance(state.t_s)
            self._status = state.status
            if state.status in _WITHOUT_TARGET:
                self._lose(state.status)
        for camera in report.cameras:
            self._take_camera(camera)
        for estimate in report.estimates:
            self._take_estimate(estimate)
        return self._advise()

    def pass_time(self, now_s: float) -> tuple[TrackEvent, ...]:
        """Evaluate the advice at session time ``now_s`` without new data; return an event if it changes."""
        self._advance(now_s)
        return self._advise()

    # ------------------------------------------------------------------------------------------ inside
    def _advance(self, now_s: float) -> None:
        """Set the time; where the clock was set back, no age is known, and what was known is forgotten."""
        if not math.isfinite(now_s):
            raise InputError("integrity: time", got=f"{now_s}", wanted="seconds of the session's clock")
        if now_s < self._now_s - self._limits.time_to_alert_s:
            self._lose(TrackStatus.SEARCHING)
            self._stations.clear()
            self._delivers_from_s = math.inf
            self._estimate_s = self._pair_s = self._fault_s = -math.inf
            self._found, self._height_m, self._now_s = None, None, now_s
        self._now_s = max(self._now_s, now_s)

    def _lose(self, status: TrackStatus) -> None:
        """Forget the target: the next one's residuals have nothing to do with it."""
        self._status = status
        self._levels.forget()
        self._looks.clear()

    def _take_camera(self, report: CameraReport) -> None:
        """Keep the look of a pixel that the filter used, for the estimate of its pair."""
        self._stations[report.station] = report
        self._delivers_from_s = min(self._delivers_from_s, report.t_s)
        found, accepted = report.result, report.innovation is not None and report.innovation.accepted
        if not (isinstance(found, Detection) and report.status.used and accepted):
            return
        if report.pan_rad is None or report.tilt_rad is None:
            return
        self._looks.setdefault(report.epoch, {})[report.station] = StationLook(
            station=report.station,
            t_s=report.t_s,
            pixel=np.array([found.u_px, found.v_px]),
            pan_rad=report.pan_rad,
            tilt_rad=report.tilt_rad,
            noise_px2=found.noise_px2,
            lasting_px2=found.covariance_px2 - found.noise_px2,
            rates=report.rates,
        )
        while len(self._looks) > _MOST_PAIRS:
            del self._looks[next(iter(self._looks))]

    def _take_estimate(self, estimate: TrackEstimate) -> None:
        """Take the answer to a pair: levels, height, and how many stations saw the aircraft."""
        looks = tuple(self._looks.pop(estimate.epoch, {}).values())
        if estimate.status in _WITHOUT_TARGET:
            self._lose(estimate.status)
            return
        known, t_s = estimate.kinematics, estimate.t_s
        if t_s >= self._estimate_s:
            self._status = estimate.status
        ahead = t_s - self._now_s > self._limits.time_to_alert_s
        # an estimate that is stamped ahead of the time is no evidence that the present one is good
        if known is None or ahead or not t_s > self._estimate_s or not _finite(known):
            return
        if not estimate.seen_by:
            return
        self._estimate_s = t_s
        self._levels.add_pair(t_s, known, looks)
        self._found = self._levels.levels(t_s, known)
        self._height_m = float(self._runway.threshold_coordinates(known.position_runway_m)[2])
        self._sink_m_s = -float(known.velocity_runway_m_s[2])
        if len(looks) > 1:
            self._pair_s = t_s
        if self._found is not None and self._found.fault_detected:
            self._fault_s, self._fault = t_s, f"{self._found.suspected}, or another fault"

    def _complaints(self) -> Iterator[str]:
        """Yield what is wrong with the stations; of one that has never delivered, once another one has for a while."""
        for name in self._names:
            report = self._stations.get(name)
            if report is None:
                if self._now_s - self._delivers_from_s > self._limits.time_to_alert_s:
                    yield f"station {name}: no picture yet"
            elif self._now_s - report.t_s > self._limits.time_to_alert_s:
                yield f"station {name}: no picture for {self._now_s - report.t_s:.1f} s"
            elif report.status is DetectionStatus.EXCLUDED:
                yield f"station {name}: excluded"
            elif isinstance(report.result, Miss) and report.result.reason in _BLIND:
                yield f"station {name}: {report.result.reason.value.replace('_', ' ')}"

    def _advise(self) -> tuple[TrackEvent, ...]:
        """Evaluate the situation; return an event if level or kind of reason has changed."""
        self._advice = advice = self._rules.advise(
            Situation(
                now_s=self._now_s,
                estimate_s=self._estimate_s,
                pair_s=self._pair_s,
                status=self._status,
                levels=self._found,
                height_m=self._height_m,
                sink_m_s=self._sink_m_s,
                fault_s=self._fault_s,
                fault=self._fault,
                complaints=tuple(self._complaints()),
            )
        )
        told = (advice.level, self._rules.kind)
        if told == self._told:
            return ()
        self._told = told
        level = "info" if advice.level is AdviceLevel.GO else "warning"
        return (TrackEvent(t_s=self._now_s, level=level, text=f"approach: {advice.level}, {advice.reason}"),)


def _finite(known: Kinematics) -> bool:
    parts = (known.position_runway_m, known.velocity_runway_m_s, known.covariance)
    return all(bool(np.isfinite(part).all()) for part in parts)
