"""How a unit does: round trips, failures, margins to its limits, and how it carries out a move."""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ptu_drivers.errors import LineError, ProtocolError, PtuError
from ptu_drivers.health import Health, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import Axis, NoReading, Reading, UnitDescription

_BAR = 40
_STUCK_S = 0.2
_STILL_S = 0.3
_TREMBLE_RAD = 1e-6  # some mounts compute their angles: the last digits change at rest
_IDLE_S = 0.01
# a line that has returned replies within 2 s
_SILENT_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PollStatistics:
    """Statistics of a series of readings.

    Attributes
    ----------
    duration_s : of the series. round_trips_s : of each reading. last : the newest reading.
    sigma_t_s : median sigma of the instants. source : how they were determined.
    health : the unit's counts at the end.
    """

    duration_s: float
    round_trips_s: tuple[float, ...]
    last: Reading
    sigma_t_s: float
    source: str
    health: Health

    @property
    def rate_hz(self) -> float:
        """Return readings of both axes in a second."""
        return len(self.round_trips_s) / self.duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveResult:
    """Result of a move of one axis.

    Attributes
    ----------
    axis : of the unit. wanted_rad, reached_rad : target, and the reported position at rest.
    lag_s : from the command to the first motion. took_s : until it was at rest. peak_rad_s : greatest rate.
    stuck_s : longest standstill between start and target: stiction, or a stall.
    quantum_rad : one step.
    lost_line : the line, or the unit's power, was lost during the move, and has returned.
    """

    axis: Axis
    wanted_rad: float
    reached_rad: float
    lag_s: float
    took_s: float
    peak_rad_s: float
    stuck_s: float
    quantum_rad: float
    lost_line: bool = False

    @property
    def lost_steps(self) -> int:
        """Return by how many steps it missed the target."""
        return round(abs(self.wanted_rad - self.reached_rad) / self.quantum_rad)


class PollMonitor:
    """Reads a unit repeatedly, and keeps the data for its statistics.

    Parameters
    ----------
    unit : the unit. now : the clock.
    """

    def __init__(self, unit: PanTiltUnit, now: Callable[[], float]) -> None:
        self._unit = unit
        self._now = now
        self._begun = now()
        self._trips: list[float] = []
        self._sigmas: list[float] = []
        self._last: Reading | None = None

    @property
    def duration_s(self) -> float:
        """Return how long it has been watched, s."""
        return self._now() - self._begun

    @property
    def rate_hz(self) -> float:
        """Return readings in a second until now."""
        return len(self._trips) / max(self.duration_s, 1e-9)

    def step(self, wait: Callable[[float], None]) -> Reading | NoReading:
        """Read once; wait briefly where that took no time."""
        asked = self._now()
        got = self._unit.read()
        if isinstance(got, NoReading):
            if self._now() == asked:
                wait(_IDLE_S)
            return got
        self._last = got
        self._trips.append(got.answered_s - got.sent_s)
        self._sigmas.append(max(got.pan.sigma_t_s, got.tilt.sigma_t_s))
        return got

    def result(self) -> PollStatistics:
        """Return the statistics. Raises ProtocolError if there was not one reading."""
        if self._last is None:
            failures = ", ".join(f"{k} {v}" for k, v in self._unit.health().failures.items())
            got = f"no angle in {self.duration_s:.0f} s ({failures})"
            raise ProtocolError(self._unit.describe().url, got=got, wanted="angles")
        return PollStatistics(
            duration_s=self.duration_s,
            round_trips_s=tuple(self._trips),
            last=self._last,
            sigma_t_s=statistics.median(self._sigmas),
            source=str(self._last.pan.source),
            health=self._unit.health(),
        )


def watch(
    unit: PanTiltUnit, duration_s: float, now: Callable[[], float], wait: Callable[[float], None]
) -> PollStatistics:
    """Read as fast as the line allows, for this time.

    Raises
    ------
    ProtocolError : not one reading.
    """
    seen = PollMonitor(unit, now)
    while seen.duration_s < duration_s:
        seen.step(wait)
    return seen.result()


def move(
    unit: PanTiltUnit,
    targets_rad: dict[Axis, float],
    rate_rad_s: float | None,
    now: Callable[[], float],
    wait: Callable[[float], None],
    timeout_s: float = 120.0,
) -> tuple[MoveResult, ...]:
    """Turn to a position, watch it, and return how each axis did.

    Raises
    ------
    PtuError : as `move_to`. ProtocolError : it did not come to rest in time; it is halted. LineError : the line was
    lost on the way, and is not back; a halt was tried.
    """
    before = first_reading(unit, now, wait, timeout_s)
    begun, breaks = now(), _breaks(unit)
    unit.move_to(pan_rad=targets_rad.get(Axis.PAN), tilt_rad=targets_rad.get(Axis.TILT), rate_rad_s=rate_rad_s)
    path: list[Reading] = [before]
    still = _angles(before)
    changed = heard = now()
    while now() - changed < _STILL_S or (_far(path[-1], targets_rad, unit.describe()) and now() - changed < 2.0):
        if now() - begun > timeout_s:
            unit.halt()
            raise ProtocolError("move", got=f"motion after {timeout_s:.0f} s", wanted="rest; it was halted")
        got = unit.read()
        if isinstance(got, NoReading):
            if now() - heard > _SILENT_S and got.state is not UnitState.STARTING:
                raise _lost(unit, got, now() - heard)
            # silence is no rest
            changed = now()
            wait(_IDLE_S)
            continue
        heard = now()
        # against where it last moved to: what trembles in the last digits rests, what creeps does not
        if any(abs(a - b) > _TREMBLE_RAD for a, b in zip(_angles(got), still, strict=True)):
            changed, still = heard, _angles(got)
        path.append(got)
    lost = _breaks(unit) != breaks
    return tuple(_moved(axis, begun, wanted, path, unit.describe(), lost) for axis, wanted in targets_rad.items())


def _breaks(unit: PanTiltUnit) -> int:
    """Return how often the line or the unit's power was lost until now."""
    health = unit.health()
    return health.reconnects + health.restarts


def halted(unit: PanTiltUnit) -> str:
    """Halt it, and return in words whether it acknowledged."""
    try:
        unit.halt()
    except PtuError:
        return "no answer to the halt: it may still move"
    return "it was halted"


def _lost(unit: PanTiltUnit, got: NoReading, silent_s: float) -> LineError:
    """Try to halt a unit that no longer replies, and return the message about it."""
    reported = f"the line lost on the way: no angle for {silent_s:.1f} s ({got.reason}); {halted(unit)}"
    return LineError(unit.describe().url, got=reported, wanted="an angle")


def _moved(
    axis: Axis, begun_s: float, wanted: float, path: Sequence[Reading], reported: UnitDescription, lost_line: bool
) -> MoveResult:
    samples = [r.pan if axis is Axis.PAN else r.tilt for r in path]
    start, end = samples[0].angle_rad, samples[-1].angle_rad
    moving = [s for s in samples if s.angle_rad != start]
    changes = [b for a, b in pairwise(samples) if b.angle_rad != a.angle_rad]
    stuck = max((b.t_s - a.t_s for a, b in pairwise(changes)), default=0.0)
    rates = [
        abs(b.angle_rad - a.angle_rad) / (b.t_s - a.t_s)
        for a, b in zip(samples, samples[4:], strict=False)
        if b.t_s > a.t_s
    ]
    return MoveResult(
        axis=axis,
        wanted_rad=wanted,
        reached_rad=end,
        lag_s=moving[0].t_s - begun_s if moving else math.nan,
        took_s=changes[-1].t_s - begun_s if changes else 0.0,
        peak_rad_s=max(rates, default=0.0),
        stuck_s=stuck,
        quantum_rad=reported.axis(axis).quantum_rad,
        lost_line=lost_line,
    )


def first_reading(
    unit: PanTiltUnit, now: Callable[[], float], wait: Callable[[float], None], timeout_s: float
) -> Reading:
    """Read until there is an angle. Raises LineError where there is none in time."""
    begun = now()
    while isinstance(got := unit.read(), NoReading):
        if now() - begun > timeout_s:
            reported = f"no angle in {timeout_s:g} s ({got.reason}, {got.state})"
            raise LineError(unit.describe().url, got=reported, wanted="one")
        wait(_IDLE_S)
    return got


def _angles(reading: Reading) -> tuple[float, float]:
    return reading.pan.angle_rad, reading.tilt.angle_rad


def _far(reading: Reading, targets_rad: dict[Axis, float], reported: UnitDescription) -> bool:
    at = dict(zip(Axis, _angles(reading), strict=True))
    return any(abs(at[axis] - wanted) > 1.5 * reported.axis(axis).quantum_rad for axis, wanted in targets_rad.items())


def format_description(reported: UnitDescription) -> str:
    """Return the unit's description as text."""
    name = " ".join(p for p in (reported.model, reported.serial) if p) or "unnamed unit"
    rows = [f"{name} on {reported.url}, {reported.protocol}", f"  {reported.firmware}"]
    for axis in Axis:
        a = reported.axis(axis)
        rows.append(
            f"  {axis:4}  {math.degrees(a.low_rad):9.3f} … {math.degrees(a.high_rad):8.3f} deg"
            f"   step {math.degrees(a.quantum_rad):.6f} deg"
            f"   {math.degrees(a.min_rate_rad_s):.3f} … {math.degrees(a.max_rate_rad_s):.3f} deg/s"
            f"   {math.degrees(a.max_acceleration_rad_s2):.1f} deg/s²"
        )
    rows.append("  can: " + ", ".join(sorted(reported.capabilities)))
    rows.append(f"  without its host: {reported.lease}")
    rows += [f"  {key}: {text}" for key, text in reported.details.items()]
    return "\n".join(rows)


def format_watched(seen: PollStatistics, reported: UnitDescription) -> str:
    """Return rate, histogram of the round trips, failures and margins, for people."""
    trips = sorted(t * 1e3 for t in seen.round_trips_s)
    middle, most = trips[len(trips) // 2], trips[int(0.95 * (len(trips) - 1))]
    rows = [
        f"{seen.rate_hz:.1f} readings/s of both axes; round trip median {middle:.1f} ms, 95 % {most:.1f}, "
        f"worst {trips[-1]:.1f}",
        f"instants by {seen.source}, sigma {seen.sigma_t_s * 1e3:.2f} ms",
        *histogram(trips),
    ]
    for axis in Axis:
        at = seen.last.pan if axis is Axis.PAN else seen.last.tilt
        a = reported.axis(axis)
        below, above = math.degrees(at.angle_rad - a.low_rad), math.degrees(a.high_rad - at.angle_rad)
        rows.append(
            f"{axis:4} {math.degrees(at.angle_rad):9.4f} deg; to the limits {below:.2f} deg below, {above:.2f} above"
        )
    h = seen.health
    failures = ", ".join(f"{reason} {n}" for reason, n in h.failures.items()) or "none"
    rows.append(
        f"failures: {failures}; resyncs {h.resyncs}, reconnects {h.reconnects}, restarts {h.restarts}, "
        f"limit messages {h.limit_events}"
    )
    return "\n".join(rows)


def format_moved(moved: MoveResult) -> str:
    """Return the result of a move as text."""
    verdict = "reached" if moved.lost_steps <= 1 else f"MISSED by {moved.lost_steps} steps"
    if moved.lost_line:
        verdict += "; THE LINE WAS LOST on the way"
    if moved.stuck_s > _STUCK_S:
        verdict += f"; STOOD STILL for {moved.stuck_s:.2f} s on the way"
    if math.isnan(moved.lag_s):
        return f"{moved.axis:4} {math.degrees(moved.reached_rad):9.4f} deg: {verdict}; did not move"
    return (
        f"{moved.axis:4} {math.degrees(moved.reached_rad):9.4f} deg of {math.degrees(moved.wanted_rad):9.4f}: "
        f"{verdict}; "
        f"moved after {moved.lag_s * 1e3:.0f} ms, at rest after {moved.took_s:.2f} s, "
        f"fastest {math.degrees(moved.peak_rad_s):.2f} deg/s"
    )


def histogram(values_ms: Sequence[float], bins: int = 12) -> list[str]:
    """Return a histogram in text; the last row contains all values beyond the 99th percentile."""
    ordered = sorted(values_ms)
    low, high = ordered[0], ordered[int(0.99 * (len(ordered) - 1))]
    width = max((high - low) / bins, 0.1)
    counts = [0] * (bins + 1)
    for value in ordered:
        counts[min(int((value - low) / width), bins)] += 1
    top = max(counts)
    rows = []
    for k, n in enumerate(counts):
        if n:
            label = f"{low + k * width:8.1f} ms" if k < bins else f"{low + bins * width:6.1f}+ ms"
            rows.append(f"  {label} {n:6d} {'#' * max(1, round(_BAR * n / top))}")
    return rows
