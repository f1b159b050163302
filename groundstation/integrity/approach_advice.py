"""GO, CAUTION or WAVE-OFF of one approach, from what is known at a time.

| finding | above the decision height | at or below it |
|---|---|---|
| no estimate, none for longer than the time to alert, track lost, no protection level | WAVE-OFF | WAVE-OFF |
| the residuals show a fault, or did within `AdviceConfig.fault_hold_s` | WAVE-OFF | WAVE-OFF |
| a protection level beyond its alert limit | CAUTION | WAVE-OFF |
| only one station sees the aircraft, or the track coasts | CAUTION | WAVE-OFF |
| a station excluded, without angles or silent, while the levels hold without it | CAUTION | CAUTION |

It gets worse at once. It gets better when the finding has been better for `recover_s`, with levels within `margin` of
their limits. Heights are the lowest that the vertical level leaves open. At or below the decision height WAVE-OFF is
latched: a go-around is not taken back. It ends when the aircraft is tracked again ``rearm_m`` above that height.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import NamedTuple

from groundstation.errors import ConfigError
from groundstation.integrity.protection_levels import ProtectionLevels
from groundstation.landing_site.alert_limits import AlertLimits
from groundstation.messages import TrackStatus


class AdviceLevel(StrEnum):
    """What the approach is advised to do."""

    GO = "GO"
    CAUTION = "CAUTION"
    WAVE_OFF = "WAVE-OFF"


_ORDER = (AdviceLevel.GO, AdviceLevel.CAUTION, AdviceLevel.WAVE_OFF)


class Finding(NamedTuple):
    """One reason for a level; ``kind`` stays while numbers in the words change."""

    level: AdviceLevel
    kind: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class AdviceConfig:
    """Tuning of the advice.

    Attributes
    ----------
    decision_height_m : over the threshold; None takes the height at which the vertical alert limit becomes the low one.
    rearm_m : above the decision height a latched wave-off ends.
    recover_s : for how long all must be better before the advice is: twice the time to alert.
    margin : share of the alert limits within which levels are good again.
    fault_hold_s : for so long after the residuals have last shown a fault it counts.
    """

    decision_height_m: float | None = None
    rearm_m: float = 5.0
    recover_s: float = 1.0
    margin: float = 0.9
    fault_hold_s: float = 3.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            # written so that NaN is none of them
            if value is not None and not 0.0 <= value <= 1e4:
                raise ConfigError(f"advice: {item.name}", got=f"{value:g}", wanted="a number from 0 to 10000")
        if not 0.0 < self.margin <= 1.0:
            raise ConfigError("advice: margin", got=f"{self.margin:g}", wanted="a share above 0, at most 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitsHere:
    """Alert limits at the height where the aircraft may be, m."""

    along_m: float
    lateral_m: float
    vertical_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachAdvice:
    """The advice at ``t_s``, session time.

    Attributes
    ----------
    level, reason : the advice, and why in words.
    levels, limits : protection levels of the newest estimate and the limits they are held against; None without one.
    height_m : lowest height over the threshold where the aircraft may be, None if unknown.
    valid_until_s : without a newer advice it is WAVE-OFF from then on: nothing may act on an older GO.
    latched : whether WAVE-OFF stays until the aircraft has climbed.
    """

    t_s: float
    level: AdviceLevel
    reason: str
    levels: ProtectionLevels | None
    limits: LimitsHere | None
    height_m: float | None
    valid_until_s: float
    latched: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What is known of the approach at ``now_s``.

    Attributes
    ----------
    estimate_s : time of the newest estimate with a pixel in it; −∞ without one.
    pair_s : time of the newest estimate with pixels of two stations; −∞ without one.
    status : of the track.
    levels : of the newest estimate.
    height_m, sink_m_s : estimated height over the threshold then, and its rate downwards.
    fault_s, fault : when the residuals last showed a fault, −∞ never; and which.
    complaints : in words what is wrong with stations.
    """

    now_s: float
    estimate_s: float
    pair_s: float
    status: TrackStatus
    levels: ProtectionLevels | None
    height_m: float | None
    sink_m_s: float
    fault_s: float
    fault: str
    complaints: Sequence[str] = ()

    @property
    def lowest_m(self) -> float | None:
        """Lowest height where the aircraft may be now."""
        if self.height_m is None:
            return None
        sunk = max(self.sink_m_s, 0.0) * max(self.now_s - self.estimate_s, 0.0)
        return self.height_m - sunk - (0.0 if self.levels is None else self.levels.vertical_m)


class AdviceRules:
    """Turns one situation after the other into advice; `advise` is to be called often, with new data or without."""

    def __init__(self, limits: AlertLimits, config: AdviceConfig) -> None:
        self._limits, self._config = limits, config
        given = config.decision_height_m
        self._decision_height_m = limits.low_height_m if given is None else given
        self._level = AdviceLevel.WAVE_OFF
        self._latched: Finding | None = None
        self._better: tuple[float, Finding] | None = None
        self._finding = Finding(AdviceLevel.WAVE_OFF, "estimate", "no estimate yet")

    @property
    def kind(self) -> str:
        """What the reason of the last advice is about."""
        return self._finding.kind

    def advise(self, situation: Situation) -> ApproachAdvice:
        """Return the advice in a situation, which is not older than the last one."""
        lowest_m = situation.lowest_m
        found = self._found(situation, lowest_m)
        self._rearm(situation, lowest_m)
        self._finding = self._settled(situation.now_s, found, lowest_m)
        self._level = self._finding.level
        return ApproachAdvice(
            t_s=situation.now_s,
            level=self._level,
            reason=self._finding.reason,
            levels=situation.levels,
            limits=None if lowest_m is None else self._limits_at(lowest_m),
            height_m=lowest_m,
            valid_until_s=situation.estimate_s + self._limits.time_to_alert_s,
            latched=self._latched is not None,
        )

    def _found(self, situation: Situation, lowest_m: float | None) -> Finding:
        """Return the worst finding; a better one than the last counts with levels well within their limits alone."""
        found = self._worst(situation, lowest_m, 1.0)
        if _ORDER.index(found.level) >= _ORDER.index(self._level):
            return found
        strict = self._worst(situation, lowest_m, self._config.margin)
        # levels that are within their limits, if only just, make nothing worse
        return strict._replace(level=min(strict.level, self._level, key=_ORDER.index))

    def _worst(self, situation: Situation, lowest_m: float | None, share: float) -> Finding:
        """Return the worst finding with levels held against a share of their limits."""
        found = [*self._of_estimate(situation), *self._of_levels(situation, lowest_m, share)]
        return max(
            found,
            key=lambda f: _ORDER.index(f.level),
            default=Finding(AdviceLevel.GO, "go", "protection levels within the alert limits"),
        )

    def _of_estimate(self, s: Situation) -> list[Finding]:
        """Return findings on estimate, track and residuals."""
        age_s = s.now_s - s.estimate_s
        if math.isinf(age_s):
            return [Finding(AdviceLevel.WAVE_OFF, "estimate", "no estimate yet")]
        found = []
        if not age_s <= self._limits.time_to_alert_s:
            found.append(Finding(AdviceLevel.WAVE_OFF, "silence", f"no estimate for {age_s:.1f} s"))
        if s.status not in (TrackStatus.TRACKING, TrackStatus.COASTING):
            found.append(Finding(AdviceLevel.WAVE_OFF, "track", f"the track is {s.status.value}"))
        if s.now_s - s.fault_s <= self._config.fault_hold_s:
            found.append(Finding(AdviceLevel.WAVE_OFF, "fault", f"the rays contradict each other: {s.fault}"))
        return found

    def _of_levels(self, s: Situation, lowest_m: float | None, share: float) -> list[Finding]:
        """Return findings on levels, held against a share of their limits, and on stations."""
        if s.levels is None or lowest_m is None:
            text = "no protection level: no pair of pictures of two stations"
            return [Finding(AdviceLevel.WAVE_OFF, "levels", text)]
        below = lowest_m <= self._decision_height_m
        doubt = AdviceLevel.WAVE_OFF if below else AdviceLevel.CAUTION
        limits = self._limits_at(lowest_m)
        found = []
        for k, axis in enumerate(("along", "lateral", "vertical")):
            level, limit = getattr(s.levels, f"{axis}_m"), getattr(limits, f"{axis}_m")
            if not level <= share * limit:
                text = f"{axis} protection level {level:.2f} m, alert limit {limit:g} m ({s.levels.worst[k]})"
                found.append(Finding(doubt, axis, text))
        if s.status is TrackStatus.COASTING or s.now_s - s.pair_s > self._limits.time_to_alert_s:
            found.append(Finding(doubt, "one station", "fewer than two stations see the aircraft"))
        if s.complaints:
            found.append(Finding(AdviceLevel.CAUTION, "stations", "; ".join(s.complaints)))
        return found

    def _rearm(self, s: Situation, lowest_m: float | None) -> None:
        """End a latched wave-off once the aircraft is tracked well above the decision height."""
        fresh = s.now_s - s.estimate_s <= self._limits.time_to_alert_s
        climbed = lowest_m is not None and lowest_m > self._decision_height_m + self._config.rearm_m
        if fresh and climbed and s.status is TrackStatus.TRACKING:
            self._latched = None

    def _settled(self, now_s: float, found: Finding, lowest_m: float | None) -> Finding:
        """Return the finding after latch and hysteresis."""
        if self._latched is not None:
            # what was better before does not count once the wave-off ends
            self._better = None
            return self._latched
        if _ORDER.index(found.level) >= _ORDER.index(self._level):
            self._better = None
        else:
            # what has been worst since it became better
            since_s, worst = self._better or (now_s, found)
            worst = max(worst, found, key=lambda f: _ORDER.index(f.level))
            self._better = (since_s, worst)
            if now_s - since_s >= self._config.recover_s:
                self._better = None
                found = worst if worst.level is not found.level else found
            else:
                reason = self._finding.reason if self._finding.kind != "go" else found.reason
                found = Finding(self._level, self._finding.kind, reason)
        if found.level is AdviceLevel.WAVE_OFF and lowest_m is not None and lowest_m <= self._decision_height_m:
            self._latched = Finding(found.level, found.kind, f"{found.reason}; latched below the decision height")
            return self._latched
        return found

    def _limits_at(self, height_m: float) -> LimitsHere:
        return LimitsHere(
            along_m=self._limits.along_m,
            lateral_m=self._limits.lateral_m,
            vertical_m=self._limits.vertical_at(height_m),
        )
