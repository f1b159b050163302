"""A pan-tilt unit that turns its lens into no closed zone: the one place that every mover of a head passes.

A command that could lead into a zone is refused before anything is sent, and motion in force is halted while there is
still room to brake. Where the lens is inside already (the unit was just switched on, the Sun has come), only motion
that leads out is let through. Times of the zones are those of the unit's clock.
"""

import threading
from collections import deque
from collections.abc import Callable

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.pointing.keep_out import ClosedZones, KeepOut, rates_are_clear
from ptu_drivers.errors import PtuError
from ptu_drivers.health import Health
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import NoReading, Reading, UnitDescription
from ptu_drivers.watchdog import Watchdog

# kept besides the zone itself: a quantum, the Sun's way during a command, ways between the points that are looked at
MARGIN_RAD = float(np.radians(0.3))
# motion in force is looked at so often, and a command to halt takes effect so late, together
LOOK_S = 0.25
# a unit that does not tell its acceleration: slower than heads for cameras of some kilograms are set to
UNKNOWN_BRAKES_RAD_S2 = float(np.radians(30.0))
_FRESH_S = 0.2
_RATE_OVER_S = 0.06
_AGAIN_S = 0.5
_WATCH_S = 0.1
_THERE_QUANTA = 1.5


class KeepOutError(PtuError):
    """A command that could turn the lens into a closed zone: refused before anything was sent."""


def brakes_of(about: UnitDescription) -> FloatArray:
    """Return how fast the axes (2,) can be braked, rad/s²."""
    stated = np.array([about.pan.max_acceleration_rad_s2, about.tilt.max_acceleration_rad_s2])
    return np.where(np.isfinite(stated), stated, UNKNOWN_BRAKES_RAD_S2)


def held_s(about: UnitDescription, lease_s: float) -> float:
    """Return how long a unit holds a rate after the last command, s: its own lease, or a longer one of its host's.

    A unit without a lease of its own is stopped by the motion guard, whose lease is no longer than the host's.
    """
    own_s = about.lease.renewed_s
    return max(lease_s, own_s) if np.isfinite(own_s) else lease_s


class KeepOutUnit(PanTiltUnit):
    """A unit that is kept out of zones.

    Parameters
    ----------
    unit : opened and probed; owned by this from now on.
    keep_out : the zones, at times of ``clock``.
    clock : the unit's.
    lease_s : motion by rate goes on for so long without a further command (`UnitSettings.watchdog_s`); longer where
        the unit's own lease is, which is all that stops it once the host has died.
    watch : supervise motion in a thread of its own between reads; without, with each call (simulated time).

    ``report`` is called with a line when motion is halted before a zone; ``stops`` and ``refused`` count.
    """

    def __init__(
        self,
        unit: PanTiltUnit,
        keep_out: KeepOut,
        clock: Callable[[], float],
        *,
        lease_s: float = 0.5,
        watch: bool = True,
        report: Callable[[str], None] | None = None,
    ) -> None:
        self.report = report
        self.stops = self.refused = 0
        self._unit, self._keep_out, self._clock = unit, keep_out, clock
        self._held_s = held_s(unit.describe(), lease_s)
        self._brakes = brakes_of(unit.describe())
        self._lock = threading.RLock()
        self._readings: deque[tuple[float, FloatArray]] = deque(maxlen=64)
        self._rates: FloatArray | None = None
        # what was commanded before, and until when the unit may still do it
        self._before: FloatArray | None = None
        self._before_until_s = -np.inf
        self._target: FloatArray | None = None
        self._checked_s = -np.inf
        self._halt_owed = False
        self._watches = watch
        self._watchdog: Watchdog | None = None

    # ------------------------------------------------------------------------------------- as the unit
    def describe(self) -> UnitDescription:
        """Return what the probe found."""
        return self._unit.describe()

    def health(self) -> Health:
        """Return the unit's counts."""
        return self._unit.health()

    def read(self) -> Reading | NoReading:
        """Ask the unit where it is, and halt it if it is about to enter a zone."""
        # outside the lock: a halt waits behind no answer
        got = self._unit.read()
        with self._lock:
            if isinstance(got, Reading):
                self._note(got)
            self._look()
        return got

    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        """Start to turn to a position. Raises `KeepOutError` where a way there leads through a zone."""
        with self._lock:
            zones = self._zones()
            here = self._here(zones)
            goal = here.copy()
            for k, value in enumerate((pan_rad, tilt_rad)):
                goal[k] = here[k] if value is None else value
            # where it still coasts to belongs to the way
            ends = [here + np.sign(v) * (np.abs(v) * LOOK_S + 0.5 * v**2 / self._brakes) for v in self._speeds()]
            lows, highs = np.min([here, *ends], axis=0), np.max([here, *ends], axis=0)
            coasts = bool(np.any(highs - lows > 1e-9))
            clear = zones.box_is_clear(_pair(here), _pair(goal), MARGIN_RAD)
            if clear and coasts:
                clear = zones.box_is_clear(_pair(np.minimum(lows, goal)), _pair(np.maximum(highs, goal)), MARGIN_RAD)
            if not clear and np.all(np.isfinite(goal)):
                self.refused += 1
                raise KeepOutError(_refusal(zones, here, f"a move to pan {_deg(goal[0])}, tilt {_deg(goal[1])}"))
            self._unit.move_to(pan_rad=pan_rad, tilt_rad=tilt_rad, rate_rad_s=rate_rad_s)
            self._supersede()
            self._target, self._checked_s = goal, self._clock()
            self._begin_to_watch()

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        """Turn at a rate. Raises `KeepOutError`, and halts, where that leads into a zone before it can be stopped."""
        with self._lock:
            wanted = np.array([pan_rad_s, tilt_rad_s])
            if np.any(wanted != 0.0) and np.all(np.isfinite(wanted)):
                zones = self._zones()
                here = self._here(zones)
                hold_s = self._age_s() + LOOK_S + self._held_s
                # noted first: the motion may be any between the present and the commanded one
                ways = [*self._speeds(), wanted]
                if not rates_are_clear(zones, here, ways, hold_s, self._brakes, MARGIN_RAD):
                    self.refused += 1
                    if self._moves():
                        self._halt()
                    reported = f"rates of {_deg(wanted[0])}/s, {_deg(wanted[1])}/s"
                    raise KeepOutError(_refusal(zones, here, reported))
            self._unit.move_at(pan_rad_s=pan_rad_s, tilt_rad_s=tilt_rad_s)
            self._supersede()
            self._rates = wanted
            self._begin_to_watch()

    def halt(self) -> None:
        """Stop both axes now; waits for nothing but the unit."""
        self._unit.halt()
        with self._lock:
            self._supersede()
            self._halt_owed = False

    def home(self) -> None:
        """Home the unit; refused while anything is closed, since nothing is known of the way that it takes."""
        with self._lock:
            zones = self._zones()
            if not zones.is_empty:
                self.refused += 1
                raise KeepOutError("home: got a way that is not known; wanted one outside the closed zones")
            self._unit.home()

    def close(self) -> None:
        """Halt and let go of the line."""
        if self._watchdog is not None:
            self._watchdog.stop()
        self._unit.close()

    # ------------------------------------------------------------------------------------ what is known
    def inside(self) -> str:
        """Return in words which zone the lens was in at its newest reading; "" for none."""
        with self._lock:
            if not self._readings:
                return ""
            zones, angles = self._zones(), _pair(self._readings[-1][1])
            return f"the lens is inside {zones.words(angles)}" if zones.at(angles) < 0.0 else ""

    def _zones(self) -> ClosedZones:
        return self._keep_out.zones(self._clock())

    def _note(self, reading: Reading) -> None:
        t_s = min(reading.pan.t_s, reading.tilt.t_s)
        if self._readings and t_s <= self._readings[-1][0]:
            # another thread's was newer
            return
        self._readings.append((t_s, np.array([reading.pan.angle_rad, reading.tilt.angle_rad])))

    def _age_s(self) -> float:
        return max(self._clock() - self._readings[-1][0], 0.0) if self._readings else np.inf

    def _here(self, zones: ClosedZones) -> FloatArray:
        """Return the newest angles (2,), asked for where they are old. Raises `KeepOutError` without any."""
        if self._age_s() > _FRESH_S:
            got = self._unit.read()
            if isinstance(got, Reading):
                self._note(got)
        if self._age_s() > _FRESH_S:
            if not zones.is_empty:
                raise KeepOutError("move: got no angles of the head; wanted them, since zones are closed to its lens")
            return np.zeros(2)
        return self._readings[-1][1]

    def _measured(self) -> FloatArray:
        """Return the rates (2,) of the last moments, 0 where it is no more than the steps of the encoder."""
        if len(self._readings) < 2:
            return np.zeros(2)
        newest_s, newest = self._readings[-1]
        before_s, before = next(
            (r for r in reversed(self._readings) if r[0] <= newest_s - _RATE_OVER_S), self._readings[0]
        )
        about = self._unit.describe()
        moved = newest - before
        moved[np.abs(moved) <= 2.0 * np.array([about.pan.quantum_rad, about.tilt.quantum_rad])] = 0.0
        return moved / (newest_s - before_s) if newest_s > before_s else np.zeros(2)

    def _speeds(self) -> list[FloatArray]:
        """Return rates (2,) between which the head's are now."""
        speeds = [self._measured()]
        if self._before is not None and self._clock() < self._before_until_s:
            speeds.append(self._before)
        if self._rates is not None:
            speeds.append(self._rates)
        return speeds

    def _moves(self) -> bool:
        return self._target is not None or any(np.any(v != 0.0) for v in self._speeds())

    def _supersede(self) -> None:
        """Note that another command replaces the one in force; the unit may take it a moment later."""
        if self._rates is not None:
            self._before, self._before_until_s = self._rates, self._clock() + LOOK_S
        self._rates = self._target = None

    # --------------------------------------------------------------------------------- motion in force
    def _look(self) -> None:
        """Halt what is about to enter a zone."""
        if self._halt_owed:
            self._halt()
        if not self._readings or not self._moves():
            return
        zones = self._zones()
        if zones.is_empty:
            return
        here = self._readings[-1][1]
        if self._target is not None:
            clear = self._still_clear(zones, here, self._target)
        else:
            # this may be the last look: then the unit holds its rate until its own lease ends
            hold_s = self._age_s() + max(LOOK_S, self._held_s)
            clear = rates_are_clear(zones, here, self._speeds(), hold_s, self._brakes, 0.5 * MARGIN_RAD)
        if not clear:
            self.stops += 1
            self._halt()
            if self.report is not None:
                self.report(f"halted before {zones.words(_pair(here))}")

    def _still_clear(self, zones: ClosedZones, here: FloatArray, target: FloatArray) -> bool:
        """Return whether the rest of the way to a position is clear now; the Sun moves on meanwhile."""
        about = self._unit.describe()
        near = _THERE_QUANTA * np.array([about.pan.quantum_rad, about.tilt.quantum_rad])
        if np.all(np.abs(target - here) <= near) and not np.any(self._measured()):
            self._target = None
            return True
        now_s = self._clock()
        if now_s - self._checked_s < _AGAIN_S:
            return True
        self._checked_s = now_s
        return zones.box_is_clear(_pair(here), _pair(target), 0.5 * MARGIN_RAD)

    def _halt(self) -> None:
        """Halt; what fails is owed, and tried again with each look."""
        self._halt_owed = True
        try:
            self._unit.halt()
        except PtuError:
            # the driver repeats it, too, and its next reading reports what is wrong with the line
            return
        self._supersede()
        self._halt_owed = False

    def _begin_to_watch(self) -> None:
        if self._watches and self._watchdog is None:
            self._watchdog = Watchdog(self._watch, _WATCH_S)

    def _watch(self) -> None:
        """Supervise motion between reads."""
        with self._lock:
            due = (self._moves() or self._halt_owed) and self._age_s() > _WATCH_S
        if due:
            try:
                self.read()
            except PtuError:
                # closed by its user meanwhile, who has halted it so
                return


def _pair(angles: FloatArray) -> tuple[float, float]:
    return float(angles[0]), float(angles[1])


def _deg(angle_rad: float) -> str:
    return f"{np.degrees(angle_rad):.1f}°"


def _refusal(zones: ClosedZones, here: FloatArray, what: str) -> str:
    other_way = " (one axis after the other may find a way)" if "move" in what else ""
    at = f"pan {_deg(here[0])}, tilt {_deg(here[1])}"
    return f"got {what} from {at}; wanted a way clear of {zones.words(_pair(here))}{other_way}"
