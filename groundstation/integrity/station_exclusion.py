"""Fault detection and exclusion: stations whose calibration or clock no longer agrees with the rig file.

Three or more stations over-determine the fix of one epoch, two stations only its height. Let y (2N,) be the stacked
pixel residuals to the filter's prediction, whitened by their noise, and H (2N, 3) their whitened Jacobian by the target
position. M = I − H (HᵀH)⁻¹ Hᵀ removes the part that a displaced target explains, so that a manoeuvre, which displaces
the pixels of all stations, has no effect. The fault hypothesis "station s has a constant error of b px" is
y = H δ + E_s b + noise; an epoch contributes A = E_sᵀ M E_s and g = E_sᵀ M y. Summed over a window, b̂ = A⁺ g, and
T_s = gᵀ A⁺ g / (1 + n ρ) is χ² distributed if there are only noise and a constant error with ρ times the variance of
the noise (calibration, target point). T_s is the squared solution separation of the fix with and without the station,
in the station's pixels: a leave-one-out test.

The largest T_s detects a fault, and its margin to the next one decides whether the faulty station is identified. If the
margin is too small (three stations have one redundant bearing), the filter innovations are used: before the filter has
followed the fault, only the innovations of the faulty station jump, so that the first station to jump is the faulty
one. With two stations T is equal for both: a fault is detected but not identified.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.integrity.solution_separation import PixelResidual, ResidualStack, SeparationTest, StationWindow

# jumps within one epoch are simultaneous
_TOGETHER_S = 0.02
# effective number of independent tests per window length, since windows overlap
_INDEPENDENT_PER_WINDOW = 5.0
# interval of the tests, short against the window
_JUDGED_EVERY_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegrityConfig:
    """Tuning of the integrity monitor.

    Attributes
    ----------
    enabled : whether stations are monitored.
    false_alarms_per_hour : of flight, over all stations, if their noise is as configured.
    window_s : length of the test window.
    min_epochs : minimum number of epochs in a window.
    constant_px : one sigma of the constant error of a station without a fault: calibration and target point bias.
    margin : minimum ratio of T of the faulty station to the next one, to identify it.
    readmit_s : an excluded station is used again after it has agreed with the others for this time.
    silent_s : a station that has delivered nothing for this time is reported.
    """

    enabled: bool = True
    false_alarms_per_hour: float = 0.1
    window_s: float = 2.0
    min_epochs: int = 5
    constant_px: float = 0.5
    margin: float = 2.0
    readmit_s: float = 3.0
    silent_s: float = 2.0

    def __post_init__(self) -> None:
        for name in ("false_alarms_per_hour", "window_s", "margin", "readmit_s", "silent_s"):
            if not 0 < getattr(self, name) <= 1e6:
                raise ValueError(f"{name} must be > 0 and at most 1e6")
        if self.min_epochs < 2 or self.constant_px < 0 or self.margin < 1:
            raise ValueError("min_epochs must be ≥ 2, constant_px ≥ 0, margin ≥ 1")


class StationVerdict(StrEnum):
    """Integrity status of a station."""

    TRUSTED = "trusted"
    DOUBTED = "doubted"  # possibly the faulty station: used with inflated noise
    EXCLUDED = "excluded"  # identified as faulty: monitored, not used


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictChange:
    """A change of the verdict of one or several stations; ``text`` is the line for the log."""

    stations: tuple[str, ...]
    verdict: StationVerdict
    text: str


class IntegrityMonitor:
    """Detects faults of the stations of one rig and excludes faulty stations."""

    def __init__(self, stations: Sequence[str], config: IntegrityConfig) -> None:
        self.exclusions = 0
        self.doubts = 0
        self._config = config
        self._windows = {name: StationWindow(config.window_s, config.constant_px) for name in stations}
        self._agrees_since: dict[str, float] = {}
        # directions that the test has seen of a fault: what one station alone agrees in is no evidence against it
        self._seen_in: dict[str, int] = {}
        self._verdicts = dict.fromkeys(stations, StationVerdict.TRUSTED)
        self._since: dict[str, float] = {}
        self._extra: dict[str, FloatArray] = {}
        self._judged_s = -math.inf
        per_hour = 3600.0 / config.window_s * _INDEPENDENT_PER_WINDOW * max(len(self._windows), 1)
        tail = min(config.false_alarms_per_hour / per_hour, 0.5)
        self._limits = {dof: float(chi_square_limit(tail, dof)) for dof in (1, 2)}

    def verdict(self, station: str) -> StationVerdict:
        """Return the current verdict on a station."""
        return self._verdicts[station]

    def extra_px2(self, station: str) -> FloatArray:
        """Return the covariance (2, 2) to add to the pixels of a doubted station; zero for the others."""
        return self._extra.get(station, np.zeros((2, 2)))

    def forget(self) -> None:
        """Clear the windows, for another target; verdicts stay."""
        for window in self._windows.values():
            window.forget()

    def add_innovation(self, station: str, t_s: float, residual_px: FloatArray, covariance_px2: FloatArray) -> None:
        """Add an innovation of the filter, accepted or not, of a used station."""
        self._windows[station].add_innovation(t_s, residual_px, covariance_px2)

    def first_jump_s(self, station: str) -> float | None:
        """Return the time of the first jump of a station's innovations in the last two windows; None without a jump."""
        return self._windows[station].first_jump_s()

    def epoch(self, t_s: float, residuals: Sequence[PixelResidual]) -> list[VerdictChange]:
        """Add the pixels of one epoch and return the verdict changes."""
        if not self._config.enabled:
            return []
        used = [self._verdicts[s.station] is not StationVerdict.EXCLUDED for s in residuals]
        together = ResidualStack.of(residuals, used)
        for k, residual in enumerate(residuals):
            # an excluded station is compared with the used ones
            self._windows[residual.station].add(t_s, residual.constant_px2, k, together)
        if t_s < self._judged_s + _JUDGED_EVERY_S:
            return []
        self._judged_s = t_s
        found = self._readmit(t_s, [s.station for s in residuals])
        if found:
            return found
        return self._detect_fault(t_s, [s.station for s, is_used in zip(residuals, used, strict=True) if is_used])

    def separation(self, station: str) -> SeparationTest:
        """Return the leave-one-out test of one station over its window."""
        return self._windows[station].separation()

    # ------------------------------------------------------------------------------------------ inside
    def _alarms(self, names: Sequence[str]) -> dict[str, SeparationTest]:
        """Return the stations whose separation exceeds the detection limit."""
        out = {}
        for name in names:
            s = self.separation(name)
            if s.epochs >= self._config.min_epochs and s.statistic > self._limits[s.dof]:
                out[name] = s
        return out

    def _alike(self, names: Sequence[str], largest: float) -> dict[str, SeparationTest]:
        """Return the stations whose separation is within the margin of the largest one, beyond the limit or not.

        Of two that are hardly distinguishable the one that exceeds it first need not be the faulty one.
        """
        tests = {name: self.separation(name) for name in names}
        least = largest / self._config.margin
        return {n: s for n, s in tests.items() if s.epochs >= self._config.min_epochs and s.statistic >= least}

    def _readmit(self, t_s: float, names: Sequence[str]) -> list[VerdictChange]:
        """Trust stations again that have agreed with the others for long enough."""
        back = []
        for name in names:
            if self._verdicts[name] is StationVerdict.TRUSTED:
                continue
            s = self.separation(name)
            # half of the limit, for hysteresis
            sees = s.epochs >= self._config.min_epochs and s.dof >= self._seen_in.get(name, 1)
            agrees = sees and s.statistic < 0.5 * self._limits[s.dof]
            if not agrees:
                self._agrees_since.pop(name, None)
            elif t_s - self._agrees_since.setdefault(name, t_s) >= self._config.readmit_s:
                back.append(name)
        for name in back:
            self._trust(name)
            self._agrees_since.pop(name, None)
        if not back:
            return []
        text = f"{_named(back)}: agrees with the others since {self._config.readmit_s:g} s, trusted again"
        return [VerdictChange(stations=tuple(back), verdict=StationVerdict.TRUSTED, text=text)]

    def _detect_fault(self, t_s: float, used: Sequence[str]) -> list[VerdictChange]:
        """Exclude the faulty station if it is identified, else doubt all that it may be."""
        alarms = self._alarms(used)
        if not alarms:
            return []
        alarms |= self._alike(used, max(s.statistic for s in alarms.values()))
        first_s = min(self._windows[name].first_s for name in alarms)
        faulty = self._identify_faulty(alarms) if len(used) >= 3 else None
        if faulty is not None:
            self._verdicts[faulty] = StationVerdict.EXCLUDED
            self._see(faulty, alarms[faulty])
            self._extra.pop(faulty, None)
            for name in used:
                # the windows of the others contain residuals to the faulty station
                self._windows[name].forget_epochs()
                if name != faulty and self._verdicts[name] is StationVerdict.DOUBTED:
                    self._trust(name)
            self._since[faulty] = first_s
            self.exclusions += 1
            off = alarms[faulty]
            u, v = off.bias_px
            text = f"{_named([faulty])}: pixels off by ({u:+.1f}, {v:+.1f}) px against the others since about"
            text += f" {first_s:.1f} s, no longer used"
            return [VerdictChange(stations=(faulty,), verdict=StationVerdict.EXCLUDED, text=text)]
        news = [name for name in alarms if self._verdicts[name] is StationVerdict.TRUSTED]
        for name, off in alarms.items():
            self._verdicts[name] = StationVerdict.DOUBTED
            self._see(name, off)
            self._extra[name] = np.outer(off.bias_px, off.bias_px)
        if not news:
            return []
        self.doubts += 1
        worst = max(float(np.hypot(*off.bias_px)) for off in alarms.values())
        text = f"{_named(list(alarms))}: rays miss each other by {worst:.1f} px since about {first_s:.1f} s;"
        text += " the wrong one cannot be identified: the covariance of all is increased"
        return [VerdictChange(stations=tuple(alarms), verdict=StationVerdict.DOUBTED, text=text)]

    def _see(self, name: str, off: SeparationTest) -> None:
        """Note in how many directions a station's fault has been seen."""
        self._seen_in[name] = max(off.dof, self._seen_in.get(name, 1))

    def _trust(self, name: str) -> None:
        """Trust a station again."""
        self._verdicts[name] = StationVerdict.TRUSTED
        self._extra.pop(name, None)
        self._seen_in.pop(name, None)

    def _identify_faulty(self, alarms: Mapping[str, SeparationTest]) -> str | None:
        """Return the faulty station, or None if it is not identifiable."""
        order = sorted(alarms, key=lambda name: alarms[name].statistic, reverse=True)
        if len(order) == 1:
            return order[0]
        margin = self._config.margin
        if alarms[order[0]].statistic > margin * alarms[order[1]].statistic:
            return order[0]
        if any(self._verdicts[name] is StationVerdict.DOUBTED for name in alarms):
            # the filter has followed the fault since: its innovations are no longer informative
            return None
        # similar separations: the station whose innovations jumped first
        alike = [name for name in order if margin * alarms[name].statistic >= alarms[order[0]].statistic]
        jumps = sorted((t_s, name) for name in alike if (t_s := self.first_jump_s(name)) is not None)
        if not jumps or (len(jumps) > 1 and jumps[1][0] - jumps[0][0] < _TOGETHER_S):
            return None
        return jumps[0][1]


def _named(stations: Sequence[str]) -> str:
    return ("station " if len(stations) == 1 else "stations ") + " and ".join(stations)
