"""The operator's status as text: track, devices, delay, dropped items."""

import math
import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.live.recent_rate import OVER_S, RecentRate
from groundstation.messages import TrackEstimate, TrackState, TrackStatus

_WORDS = {
    TrackStatus.SEARCHING: "searching the sky",
    TrackStatus.ACQUIRING: "candidate detected: being confirmed",
    TrackStatus.TRACKING: "tracking",
    TrackStatus.COASTING: "coasting: predicted, no fix of two cameras",
    TrackStatus.LOST: "lost: searching the predicted region",
}
# the age beyond which a newest pair is reported, and the age beyond which a state counts as unknown
_OLD_S, _STALE_S = 0.5, 1.0
# a receiver that has given no position for so long is gone
GONE_S = 2.0
# a device without data for longer is silent
SILENT_S = 1.0
# all delays of a day, in bins; the last one holds what is longer
_BIN_S, _BINS = 0.00025, 8000


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceState:
    """How a device does: how often it delivers, Hz, how old its newest is, s, and further notes on it.

    ``trouble`` is whether a note is of something that should not be.
    """

    name: str
    rate_hz: float
    age_s: float
    note: str = ""
    trouble: bool = False

    @property
    def silent(self) -> bool:
        """Whether nothing has come for a second, or nothing ever."""
        return self.age_s > SILENT_S

    def summary(self) -> str:
        """Return it in a few words."""
        if not math.isfinite(self.age_s):
            return f"{self.name} nothing yet" + (f", {self.note}" if self.note else "")
        quiet = f", silent for {self.age_s:.1f} s" if self.silent else ""
        return f"{self.name} {self.rate_hz:.0f} Hz{quiet}" + (f", {self.note}" if self.note else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceState(DeviceState):
    """How the reference receiver does: how many ``fixes`` it gave, and when the newest came, session time, s."""

    fixes: int = 0
    newest_s: float = -math.inf

    def summary(self) -> str:
        """Return it in a few words."""
        rest = f", {self.note}" if self.note else ""
        if not self.fixes:
            return f"DGPS: no position yet{rest}"
        if self.age_s > GONE_S:
            return f"DGPS: gone since {self.newest_s:.1f} s, after {self.fixes} fixes{rest}"
        return f"DGPS: {self.fixes} fixes, {self.age_s:.1f} s old{rest}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveStatus:
    """The state of the station at ``t_s``, as figures and as lines for a person.

    ``lines`` are all there is; of these the first ``device_from`` are on the aircraft, and follow one on each device.
    """

    t_s: float
    track: TrackStatus
    latency_p50_ms: float
    latency_p99_ms: float
    devices: tuple[DeviceState, ...]
    dropped: Mapping[str, int]
    lines: tuple[str, ...]
    device_from: int = 1

    def rows(self, *, details: bool) -> list[tuple[str, bool]]:
        """Return lines, and whether each is of a silent device; without ``details`` only on devices in trouble."""
        after = self.device_from + len(self.devices)
        described = list(zip(self.devices, self.lines[self.device_from : after], strict=True))
        shown = [(line, d.silent) for d, line in described if details or d.silent or d.trouble]
        well = [d.name for d in self.devices if not (details or d.silent or d.trouble)]
        if well:
            shown.append((f"in order: {', '.join(well)}", False))
        return (
            [(line, False) for line in self.lines[: self.device_from]]
            + shown
            + [(e, False) for e in self.lines[after:]]
        )

    def one_line(self, *, details: bool = True) -> str:
        """Return the whole in one line."""
        return " · ".join(line for line, _ in self.rows(details=details))


def dropped_text(dropped: Mapping[str, int]) -> str:
    """Return what was dropped and how much of it, one of a kind in the singular."""
    one = {what: re.sub("^([a-z]+)s", r"\1", what) for what in dropped}
    return "dropped: " + ", ".join(f"{n} {one[what] if n == 1 else what}" for what, n in dropped.items())


class StatusBoard:
    """Collects the content of `LiveStatus`."""

    def __init__(self) -> None:
        self._arrived: dict[int, float] = {}
        self._latencies: deque[tuple[float, float]] = deque()
        self._histogram = np.zeros((2, _BINS), np.int64)
        self._counts: dict[str, RecentRate] = {}
        self._newest: TrackEstimate | TrackState | None = None
        self._pair_s: float | None = None

    def arrived(self, epoch: int, arrived_s: float) -> None:
        """Note when the first frame of a pair arrived."""
        self._arrived.setdefault(epoch, arrived_s)
        if len(self._arrived) > 1000:
            self._arrived.pop(next(iter(self._arrived)))

    def answered(self, estimate: TrackEstimate, now_s: float) -> None:
        """Note the answer to a pair."""
        self._newest, self._pair_s = estimate, estimate.t_s
        arrived_s = self._arrived.pop(estimate.epoch, None)
        if arrived_s is not None:
            self._latencies.append((now_s, now_s - arrived_s))
            place = min(max(int((now_s - arrived_s) / _BIN_S), 0), _BINS - 1)
            self._histogram[int(estimate.status is TrackStatus.TRACKING), place] += 1

    def passed(self, state: TrackState) -> None:
        """Note how the target does at a time without a pair."""
        self._newest = state

    def latency_ms(self, percent: float, *, tracking: bool = False) -> float:
        """Return a percentile of the delays from a pair's first frame to its answer, ms; 0 before the first.

        Of all answers, or of those while ``tracking``: searching looks at whole pictures.
        """
        summed = np.cumsum(self._histogram[1] if tracking else self._histogram.sum(axis=0))
        if summed[-1] == 0:
            return 0.0
        return 1e3 * _BIN_S * float(np.searchsorted(summed, 0.01 * percent * summed[-1]) + 1)

    def rate(self, name: str, count: int, now_s: float) -> float:
        """Return how often a second something was counted lately."""
        return self._counts.setdefault(name, RecentRate()).at(now_s, count)

    def status(
        self,
        now_s: float,
        track: TrackStatus,
        devices: tuple[DeviceState, ...],
        dropped: Mapping[str, int],
        also: str,
        approach: tuple[str, ...] = (),
    ) -> LiveStatus:
        """Return the lines to show now; ``also`` are those of the recorder, ``approach`` those of the approach."""
        while self._latencies and self._latencies[0][0] < now_s - OVER_S:
            self._latencies.popleft()
        recent = [delay for _, delay in self._latencies]
        p50, p99 = (1e3 * float(np.percentile(recent, q)) if recent else 0.0 for q in (50, 99))
        lines = [self._track(now_s, track), *approach]
        lines += [device.summary() for device in devices]
        if recent:
            lines.append(f"delay {p50:.0f} ms, 99 % within {p99:.0f} ms")
        if dropped:
            lines.append(dropped_text(dropped))
        if also:
            lines.append(also)
        return LiveStatus(
            t_s=now_s,
            track=track,
            latency_p50_ms=p50,
            latency_p99_ms=p99,
            devices=devices,
            dropped=dict(dropped),
            lines=tuple(lines),
            device_from=1 + len(approach),
        )

    def _track(self, now_s: float, track: TrackStatus) -> str:
        """Return how the track is at ``now_s``: a state that is too old is shown as unknown."""
        newest, pair_s = self._newest, self._pair_s
        if newest is not None and newest.t_s < 0.0:
            # before the session's time zero: the pipeline's state at its start, not an answer
            return "unknown: no pair processed yet"
        if newest is not None and now_s - newest.t_s > _STALE_S:
            return f"unknown: was {track.value}, no status for the last {now_s - newest.t_s:.1f} s"
        quiet = "" if pair_s is None or now_s - pair_s <= _OLD_S else f", no pair for {now_s - pair_s:.1f} s"
        return self._words(track) + self._where() + quiet

    def _words(self, track: TrackStatus) -> str:
        """Return what a status means; of one camera alone, that range and its sigma are no measurement."""
        newest = self._newest
        if track is TrackStatus.COASTING and isinstance(newest, TrackEstimate) and len(newest.seen_by) == 1:
            return f"coasting: bearing only, {next(iter(newest.seen_by))} alone sees it"
        return _WORDS[track]

    def _where(self) -> str:
        """Return where the target is, with one sigma."""
        newest = self._newest
        if newest is None or newest.kinematics is None:
            return ""
        # as rounded, and without a zero's sign
        x, y, z = (round(float(v), 1) + 0.0 for v in newest.kinematics.position_runway_m)
        sigma = np.sqrt(np.diag(newest.kinematics.covariance)[:3])
        return f" at {y:.0f} ± {sigma[1]:.1f} m, x {x:+.1f} ± {sigma[0]:.2f}, z {z:.1f} ± {sigma[2]:.2f}"
