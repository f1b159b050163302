"""Fit of a camera's clock to the host's clock, from arrival times: the line under all arrivals (lower envelope).

It runs while the camera delivers frames. The offset of a PTU's clock to a camera's is calibrated from recordings in
`calibration/clocks/ptu_clock_fit.py`.

Host time of an event is y = a + (1 + b)·x for the device's stamp x, and a frame arrives e ≥ 0 later: network, bus,
driver and scheduler only ever delay. The line is therefore below all arrivals and touches some: it supports their lower
convex hull.
With delays exponential of scale τ and a prior N(0, σ_b²) for the drift, the most likely line is

    max over (a, b) of  −Σ (y_i − a − (1 + b)·x_i)/τ − b²/(2σ_b²)   subject to all residuals ≥ 0,

a concave function of b whose pieces correspond to the hull's corners, solved exactly on each
(docs/derivation.md, section 20).
"""

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np

from groundstation.arrays import FloatArray


class ClockChange(StrEnum):
    """Changes of the device's clock that a stamp shows."""

    NONE = "none"
    JUMP = "jump"
    RESET = "reset"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFitConfig:
    """Tuning of the clock fit.

    Parameters
    ----------
    bin_s, bins : the earliest arrival of each bin is kept, of the last ``bins`` bins.
    drift_sigma : of a crystal oscillator, s/s, a priori.
    jump_s : smaller shifts count as delay.
    confirm_s : time for which all arrivals are late by ``jump_s`` before the clock counts as having jumped.
    floor_s : lower limit of the sigma: the host's scheduler, the device's tick.
    settled : least number of bins before a jump is detected.
    """

    bin_s: float = 0.5
    bins: int = 120
    drift_sigma: float = 50e-6
    jump_s: float = 0.02
    confirm_s: float = 2.0
    floor_s: float = 20e-6
    settled: int = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockReading:
    """Host time of a device's stamp with one sigma, s, and the clock change that the stamp shows."""

    t_s: float
    sigma_s: float
    change: ClockChange


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFitState:
    """The line as it is: host − device at the last stamp, s; drift, s/s, with sigmas; arrivals over it, s."""

    offset_s: float
    drift: float
    sigma_s: float
    drift_sigma: float
    spread_s: float
    bins: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _ClockLine:
    """y = y0 + (1 + drift)·(x − x0); ``spread_s`` is twice the bins' median over it."""

    x0: float
    y0: float
    drift: float
    drift_sigma: float
    spread_s: float
    bins: int

    def at(self, x: float) -> float:
        return self.y0 + (1.0 + self.drift) * (x - self.x0)


class ClockFit:
    """Follows one device's clock, stamp by stamp, in order of arrival."""

    def __init__(self, config: ClockFitConfig | None = None) -> None:
        self._config = config or ClockFitConfig()
        self._bins: deque[tuple[float, float]] = deque(maxlen=self._config.bins)
        self._line: _ClockLine | None = None
        self._origin_ns = 0
        self._bin_start = -math.inf
        self._last: tuple[float, float] | None = None
        self._early: list[tuple[float, float]] = []
        self._late: list[tuple[float, float]] = []

    def restart(self) -> None:
        """Forget everything: the device has been reopened."""
        self._bins.clear()
        self._line = None
        self._last = None
        self._bin_start = -math.inf
        self._early = []
        self._late = []

    def take(self, device_ns: int, arrival_s: float) -> ClockReading:
        """Return the host time of a device's stamp, given when it could have arrived at the earliest.

        Parameters
        ----------
        device_ns : the device's stamp of some moment, ns.
        arrival_s : arrival in the host's clock less the least delay since that moment, s.
        """
        if self._last is None:
            self._origin_ns = device_ns
        x = (device_ns - self._origin_ns) * 1e-9
        change = self._change(x, arrival_s)
        if change is ClockChange.RESET:
            self.restart()
            self._origin_ns, x = device_ns, 0.0
        self._last = (x, arrival_s)
        if not self._late and not self._early:
            self._keep(x, arrival_s)
        line = self._fit()
        # nothing arrives before it is sent
        t_s = min(line.at(x), arrival_s)
        return ClockReading(t_s=t_s, sigma_s=math.hypot(self._sigma(line, x), self._doubt(line)), change=change)

    @property
    def state(self) -> ClockFitState | None:
        """Return the line at the last stamp; None before the first."""
        # read once: another thread may call this
        last, line = self._last, self._line
        if last is None or line is None:
            return None
        x = last[0]
        return ClockFitState(
            offset_s=line.at(x) - x - self._origin_ns * 1e-9,
            drift=line.drift,
            sigma_s=self._sigma(line, x),
            drift_sigma=line.drift_sigma,
            spread_s=line.spread_s,
            bins=line.bins,
        )

    def _change(self, x: float, y: float) -> ClockChange:
        """Compare a stamp with the line; after a jump the old line is forgotten."""
        if self._last is not None and x <= self._last[0]:
            return ClockChange.RESET
        line = self._line
        if line is None or line.bins < self._config.settled:
            return ClockChange.NONE
        least = max(self._config.jump_s, 8.0 * self._sigma(line, x))
        late_s = y - line.at(x)
        self._early = [*self._early, (x, y)] if late_s < -least else []
        self._late = [*self._late, (x, y)] if late_s > least else []
        confirmed = self._late and y - self._late[0][1] >= self._config.confirm_s
        # three in a row: one alone may be a stamp gone wrong
        if not confirmed and len(self._early) < 3:
            return ClockChange.NONE
        points = self._late or self._early
        jumped = abs(late_s) > 1.0
        self.restart()
        for point in points:
            self._keep(*point)
        return ClockChange.RESET if jumped else ClockChange.JUMP

    def _keep(self, x: float, y: float) -> None:
        """Keep the earliest arrival of each bin."""
        if x >= self._bin_start + self._config.bin_s or not self._bins:
            self._bin_start = x
            self._bins.append((x, y))
            self._line = None
            return
        drift = 0.0 if self._line is None else self._line.drift
        best_x, best_y = self._bins[-1]
        if y - (1.0 + drift) * x < best_y - (1.0 + drift) * best_x:
            self._bins[-1] = (x, y)
            self._line = None

    def _fit(self) -> _ClockLine:
        """Return the line under the bins."""
        if self._line is None:
            self._line = envelope(np.array(self._bins), self._config.drift_sigma)
        return self._line

    def _sigma(self, line: _ClockLine, x: float) -> float:
        """Return one sigma of the line at x, s.

        The line is late by the shortest delay that occurred, which is unknown: nearly zero where short delays are
        common, as large as the bins' scatter where they are rare. From few bins it is uncertain (Student's t).
        """
        level = line.spread_s * math.sqrt(line.bins / max(line.bins - 4.0, 1.0))
        unsettled = self._config.jump_s / 2.0 if line.bins < self._config.settled else 0.0
        return math.hypot(level, line.drift_sigma * (x - line.x0), self._config.floor_s, unsettled)

    def _doubt(self, line: _ClockLine) -> float:
        """Return the possible error of the line while arrivals contradict it, s; a few late ones are only late."""
        if self._early:
            return max(line.at(x) - y for x, y in self._early)
        if not self._late or self._late[-1][1] - self._late[0][1] < self._config.confirm_s / 4.0:
            return 0.0
        return min(y - line.at(x) for x, y in self._late)


def envelope(points: FloatArray, drift_sigma: float) -> _ClockLine:
    """Return the most likely line under ``points`` (n, 2): device's x, host's y, in s, x rising."""
    x0, y0 = (float(v) for v in points.mean(axis=0))
    x = points[:, 0] - x0
    y = points[:, 1] - y0 - x
    n = len(points)
    drift = 0.0
    # as lists: for a hundred points Python's own numbers are several times as fast as numpy's one by one
    hull = [(float(x[k]), float(y[k])) for k in _lower_hull(x.tolist(), y.tolist())]
    width = float(np.sqrt(np.mean(x * x)))
    scale = _mean_over_least(y)
    if n > 1 and width > 0.0:
        # the delays' scale from the line without drift is too large at first: the drift then follows the prior too much
        for _ in range(3):
            drift = _best_drift(hull, n, max(scale, 1e-9), drift_sigma)
            scale = _mean_over_least(y - drift * x)
    over = np.sort(y - drift * x)
    base = float(over[0])
    # for exponential delays the rms; a camera that is held up for seconds does not change it. Of the median's two
    # middle ones of an even number, the mean
    spread = float(over[(n - 1) // 2] - base) + float(over[n // 2] - base)
    fitted = spread / (width * math.sqrt(n)) if width > 0.0 and n > 2 else math.inf
    return _ClockLine(
        x0=x0,
        y0=y0 + base,
        drift=drift,
        drift_sigma=drift_sigma
        if math.isinf(fitted)
        else 1.0 / math.hypot(1.0 / max(fitted, 1e-12), 1.0 / drift_sigma),
        spread_s=spread,
        bins=n,
    )


def _mean_over_least(values: FloatArray) -> float:
    """Return by how much values (n,) are larger than the least of them, on average."""
    return float(np.add.reduce(values - values.min())) / len(values)


def _best_drift(hull: list[tuple[float, float]], n: int, scale: float, drift_sigma: float) -> float:
    """Return the drift of the most likely line under ``n`` points of which these are the hull; x has mean zero.

    While the line turns about corner k, its slope is between those of the hull's two sides there, and the gain's
    derivative is −n·x_k/τ − b/σ²: the best b is where it vanishes, or the side at which it changes sign.
    """
    slopes = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(hull)]
    lows, highs = [-math.inf, *slopes], [*slopes, math.inf]
    pull = n * drift_sigma**2 / scale
    best = 0.0
    for (x, _), low, high in zip(hull, lows, highs, strict=True):
        best = max(-pull * x, low)
        if best <= high:
            break
    return best


def _lower_hull(x: list[float], y: list[float]) -> list[int]:
    """Return the corners of the lower convex hull, from left to right; x rises."""
    hull: list[int] = []
    for i in range(len(x)):
        while len(hull) >= 2:
            a, b = hull[-2], hull[-1]
            if (x[b] - x[a]) * (y[i] - y[a]) > (y[b] - y[a]) * (x[i] - x[a]):
                break
            hull.pop()
        hull.append(i)
    return hull
