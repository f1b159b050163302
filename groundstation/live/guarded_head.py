"""One station's head, turned by a user's command before the flight: slowly, and halted however the program ends.

Ctrl-C and errors halt it in the context's end; where the program itself is lost, the motion guard's process does.
"""

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from groundstation.errors import GroundstationError
from groundstation.live.child_process import ChildProcess
from groundstation.live.head_device import DeviceError, HeadDevice
from groundstation.live.keep_out_unit import KeepOutError, KeepOutUnit
from groundstation.live.keep_out_zones import open_station_head
from groundstation.live.motion_guard_process import halt_lines
from groundstation.rig.rig import Rig
from groundstation.session.folder import GeoOrigin
from ptu_drivers.deferred_termination import ENDING
from ptu_drivers.errors import LimitError, PtuError
from ptu_drivers.messages import Axis, Capability, Reading
from ptu_drivers.monitor import MoveResult, first_reading, halted, move
from ptu_drivers.motion_guard import HALTING_S, LEASE_S, MotionLeases, serve_guard

_GUARD_START_S = 30.0
_PATIENCE_S = 5.0
# of the fastest speed, as `ptu jog`
_SLOW_SHARE = 0.1
_ASK_S, _TERMINATE_S = 0.5, 0.2


class GuardedHead:
    """The head of one station of a station file, kept out of what is closed to it.

    Parameters
    ----------
    rate_rad_s : speed of its moves; None is a tenth of its fastest, or its own where it takes none.
    report : called with a line where motion is halted before a closed zone.
    rig, origin : in place of the station file's; None keeps them.

    Raises `DeviceError` or `ConfigError` on ``with``.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        device: HeadDevice,
        *,
        rate_rad_s: float | None = None,
        report: Callable[[str], None],
        rig: Rig | None = None,
        origin: GeoOrigin | None = None,
    ) -> None:
        self._path, self._name, self._device = path, name, device
        self._rig, self._origin = rig, origin
        self._rate_rad_s, self._report = rate_rad_s, report
        self._leases = MotionLeases([name])
        self._stack = ExitStack()

    def __enter__(self) -> "GuardedHead":
        with ExitStack() as stack:
            self._guard = ChildProcess("ptu-guard", serve_guard, halt_lines({self._name: self._device}), self._leases)
            stack.callback(self._guard.end, "stop", _ASK_S, _TERMINATE_S)
            self._unit = open_station_head(
                self._path, self._name, time.monotonic, time.time, rig=self._rig, origin=self._origin
            )
            stack.callback(self._close)
            if isinstance(self._unit, KeepOutUnit):
                self._unit.report = self._report
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def read(self) -> Reading:
        """Return the angles; raises `DeviceError` where there are none for some seconds."""
        try:
            return first_reading(self._unit, time.monotonic, time.sleep, _PATIENCE_S)
        except PtuError as fault:
            raise self._fault(fault) from fault

    def turn_to(self, pan_rad: float, tilt_rad: float) -> tuple[MoveResult, ...]:
        """Turn to angles, rad, and return once it stands; raises `DeviceError` where it does not get there."""
        self._await_guard()
        targets = {Axis.PAN: pan_rad, Axis.TILT: tilt_rad}
        try:
            moved = move(self._unit, targets, self._speed_rad_s(), self._renewing_clock, time.sleep)
        except (LimitError, KeepOutError) as fault:
            # nothing was sent
            self._leases.release(self._name)
            raise self._fault(fault) from fault
        except PtuError as fault:
            reported = halted(self._unit)
            self._release_if_halted()
            raise DeviceError(f"{self._name}: PTU: {fault}; {reported}") from fault
        self._leases.release(self._name)
        return moved

    def _speed_rad_s(self) -> float | None:
        about = self._unit.describe()
        if self._rate_rad_s is not None or Capability.SPEED not in about.capabilities:
            return self._rate_rad_s
        axes = (about.pan, about.tilt)
        return max(_SLOW_SHARE * min(a.max_rate_rad_s for a in axes), *(a.min_rate_rad_s for a in axes))

    def _renewing_clock(self) -> float:
        """Return the time; each look at it, once a reading during a move, renews the lease."""
        now_s = time.monotonic()
        self._leases.set_driver_heartbeat(now_s)
        self._leases.renew(self._name, now_s + self._unit.describe().reply_timeout_s + LEASE_S)
        return now_s

    def _release_if_halted(self) -> bool:
        owed = self._unit.health().halt_owed
        if not owed:
            self._leases.release(self._name)
        return not owed

    def _await_guard(self) -> None:
        end_s = time.monotonic() + _GUARD_START_S
        while time.monotonic() - self._leases.guard_heartbeat_s > LEASE_S:
            if time.monotonic() > end_s or not self._guard.is_alive():
                raise GroundstationError(f"{self._name}: PTU: not turned: its motion guard does not run")
            time.sleep(0.02)

    def _close(self) -> None:
        # a SIGTERM to the group is not to end the guard before the halt
        self._guard.send(ENDING)
        self._unit.close()
        if not self._release_if_halted() and self._guard.send("halt"):
            # over a connection of its own; what came of it makes no difference here
            self._guard.pipe.poll(HALTING_S + LEASE_S)

    def _fault(self, fault: PtuError) -> DeviceError:
        return DeviceError(f"{self._name}: PTU: {fault}")
