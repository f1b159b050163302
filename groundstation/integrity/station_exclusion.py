"""Is each station still where and when the rig file says? Faults found in the pictures alone, and which to leave out.

Three or more stations over-determine the fix of one epoch, two its height only. Let y (2N,) be the stacked pixels'
residuals about the filter's prediction, whitened by their noise, and H (2N, 3) their whitened Jacobian by the target's
position. M = I − H (HᵀH)⁻¹ Hᵀ takes away whatever a moved target would explain, so a manoeuvre, in which all stations
jump together, leaves nothing. "Station s is off by a constant b px": y = H δ + E_s b + noise, of which an epoch tells
A = E_sᵀ M E_s and g = E_sᵀ M y. Summed over a window, b̂ = A⁺ g, and T_s = gᵀ A⁺ g / (1 + n ρ) is χ² if nothing is off
but noise and a constant error of variance ρ times the noise's (calibration, the nose). T_s is the squared solution
separation of the fix with and without the station, in its own pixels: a leave-one-out test.

The largest T_s finds the fault, its distance from the next says whether it is known whose it is. Where T does not tell
(three stations have one bearing to spare), the filter's own innovations may: until the filter has believed a fault,
only the faulty station's jump, so whose jumped first is to blame. With two stations T is the same for both: the fault
is seen, not whose it is.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.integrity.solution_separation import PixelResidual, Separation, SightStack, StationWindow

# jumps within one epoch are simultaneous
_TOGETHER_S = 0.02
# windows overlap: so many of them are as good as independent, each window's length
_INDEPENDENT_PER_WINDOW = 5.0
# a window of seconds does not change its mind from one picture to the next
_JUDGED_EVERY_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegrityConfig:
    """Tuning of the watch over the stations.

    Attributes
    ----------
    enabled : whether stations are watched at all.
    false_alarms_per_hour : of flight, over all stations, if their noise is what it is said to be.
    window_s : epochs of this time are judged together.
    min_epochs : and at least so many.
    constant_px : one sigma of a station's constant error that is no fault: calibration and the nose's bias.
    margin : T of the faulty station over the next one's, to be sure whose fault it is.
    readmit_s : an excluded station is used again after it has agreed with the others for so long.
    silent_s : a station that has delivered nothing for so long is reported.
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
                raise ValueError(f"{name} must be > 0")
        if self.min_epochs < 2 or self.constant_px < 0 or self.margin < 1:
            raise ValueError("min_epochs must be ≥ 2, constant_px ≥ 0, margin ≥ 1")


class StationVerdict(StrEnum):
    """What is held of a station."""

    TRUSTED = "trusted"
    DOUBTED = "doubted"  # something is off, it may be this one: used with more noise
    EXCLUDED = "excluded"  # known to be off: watched, not used


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A change of a station's verdict, or of several at once; ``text`` says it in plain words."""

    stations: tuple[str, ...]
    verdict: StationVerdict
    text: str


class IntegrityWatch:
    """Watches the stations of one rig."""

    def __init__(self, stations: Sequence[str], config: IntegrityConfig) -> None:
        self.exclusions = 0
        self.doubts = 0
        self._config = config
        self._windows = {name: StationWindow(config.window_s, config.constant_px) for name in stations}
        self._agrees_since: dict[str, float] = {}
        self._verdicts = dict.fromkeys(stations, StationVerdict.TRUSTED)
        self._since: dict[str, float] = {}
        self._extra: dict[str, FloatArray] = {}
        self._judged_s = -math.inf
        per_hour = 3600.0 / config.window_s * _INDEPENDENT_PER_WINDOW * max(len(self._windows), 1)
        tail = min(config.false_alarms_per_hour / per_hour, 0.5)
        self._limits = {dof: float(chi2.isf(tail, dof)) for dof in (1, 2)}

    def verdict(self, station: str) -> StationVerdict:
        """Return what is held of a station now."""
        return self._verdicts[station]

    def extra_px2(self, station: str) -> FloatArray:
        """Return the covariance (2, 2) to add to a doubted station's pixels; zero for the others."""
        return self._extra.get(station, np.zeros((2, 2)))

    def forget(self) -> None:
        """Start the windows anew (another target); verdicts stay."""
        for window in self._windows.values():
            window.forget()

    def judged(self, station: str, t_s: float, residual_px: FloatArray, covariance_px2: FloatArray) -> None:
        """Take an innovation of the filter, accepted or not, of a station that is used."""
        self._windows[station].judged(t_s, residual_px, covariance_px2)

    def jumped_s(self, station: str) -> float | None:
        """Return when a station's innovations began to jump, within the last two windows; None if they did not."""
        return self._windows[station].jumped_s()

    def epoch(self, t_s: float, sights: Sequence[PixelResidual]) -> list[Finding]:
        """Take the pixels of one epoch and return which verdicts they change."""
        if not self._config.enabled:
            return []
        used = [self._verdicts[s.station] is not StationVerdict.EXCLUDED for s in sights]
        together = SightStack.of(sights, used)
        for k, sight in enumerate(sights):
            # a station that is left out is held against those that are not
            self._windows[sight.station].add(t_s, sight.constant_px2, k, together)
        if t_s < self._judged_s + _JUDGED_EVERY_S:
            return []
        self._judged_s = t_s
        found = self._readmit(t_s, [s.station for s in sights])
        if found:
            return found
        return self._accuse(t_s, [s.station for s, is_used in zip(sights, used, strict=True) if is_used])

    def separation(self, station: str) -> Separation:
        """Return the window's leave-one-out test of one station."""
        return self._windows[station].separation()

    # ------------------------------------------------------------------------------------------ inside
    def _alarms(self, names: Sequence[str]) -> dict[str, Separation]:
        """Return those whose separation is beyond what noise makes of it."""
        out = {}
        for name in names:
            s = self.separation(name)
            if s.epochs >= self._config.min_epochs and s.statistic > self._limits[s.dof]:
                out[name] = s
        return out

    def _readmit(self, t_s: float, names: Sequence[str]) -> list[Finding]:
        """Trust again who has agreed for long enough."""
        back = []
        for name in names:
            if self._verdicts[name] is StationVerdict.TRUSTED:
                continue
            s = self.separation(name)
            # half of the limit: in and out are not to be the same step
            agrees = s.epochs >= self._config.min_epochs and s.statistic < 0.5 * self._limits[s.dof]
            if not agrees:
                self._agrees_since.pop(name, None)
            elif t_s - self._agrees_since.setdefault(name, t_s) >= self._config.readmit_s:
                back.append(name)
        for name in back:
            self._verdicts[name] = StationVerdict.TRUSTED
            self._agrees_since.pop(name, None)
            self._extra.pop(name, None)
        if not back:
            return []
        text = f"{_named(back)}: agrees with the others since {self._config.readmit_s:g} s, trusted again"
        return [Finding(stations=tuple(back), verdict=StationVerdict.TRUSTED, text=text)]

    def _accuse(self, t_s: float, used: Sequence[str]) -> list[Finding]:
        """Exclude the one station that is off, or doubt all those that may be."""
        alarms = self._alarms(used)
        if not alarms:
            return []
        first_s = min(self._windows[name].first_s for name in alarms)
        guilty = self._guilty(alarms) if len(used) >= 3 else None
        if guilty is not None:
            self._verdicts[guilty] = StationVerdict.EXCLUDED
            self._extra.pop(guilty, None)
            for name in used:
                # what the others were held against was wrong
                self._windows[name].forget_epochs()
                if name != guilty and self._verdicts[name] is StationVerdict.DOUBTED:
                    self._verdicts[name] = StationVerdict.TRUSTED
                    self._extra.pop(name, None)
            self._since[guilty] = first_s
            self.exclusions += 1
            off = alarms[guilty]
            u, v = off.bias_px
            text = f"{_named([guilty])}: pixels off by ({u:+.1f}, {v:+.1f}) px against the others since about"
            text += f" {first_s:.1f} s, no longer used"
            return [Finding(stations=(guilty,), verdict=StationVerdict.EXCLUDED, text=text)]
        news = [name for name in alarms if self._verdicts[name] is StationVerdict.TRUSTED]
        for name, off in alarms.items():
            self._verdicts[name] = StationVerdict.DOUBTED
            self._extra[name] = np.outer(off.bias_px, off.bias_px)
        if not news:
            return []
        self.doubts += 1
        worst = max(float(np.hypot(*off.bias_px)) for off in alarms.values())
        text = f"{_named(list(alarms))}: rays miss each other by {worst:.1f} px since about {first_s:.1f} s;"
        text += " which of them is off cannot be told, all are trusted less"
        return [Finding(stations=tuple(alarms), verdict=StationVerdict.DOUBTED, text=text)]

    def _guilty(self, alarms: Mapping[str, Separation]) -> str | None:
        """Return the station that is off, or None if it cannot be told."""
        order = sorted(alarms, key=lambda name: alarms[name].statistic, reverse=True)
        if len(order) == 1:
            return order[0]
        margin = self._config.margin
        if alarms[order[0]].statistic > margin * alarms[order[1]].statistic:
            return order[0]
        if any(self._verdicts[name] is StationVerdict.DOUBTED for name in alarms):
            # the filter has gone along with the fault since: innovations no longer tell
            return None
        # the separations are alike: whose innovations jumped first?
        alike = [name for name in order if margin * alarms[name].statistic >= alarms[order[0]].statistic]
        jumps = sorted((t_s, name) for name in alike if (t_s := self.jumped_s(name)) is not None)
        if not jumps or (len(jumps) > 1 and jumps[1][0] - jumps[0][0] < _TOGETHER_S):
            return None
        return jumps[0][1]


def _named(stations: Sequence[str]) -> str:
    return ("station " if len(stations) == 1 else "stations ") + " and ".join(stations)
