"""What the FLIR driver puts on the line and reports, call by call in virtual time, in one text per scenario.

    python -m tests.ptu_drivers.flir.wire_traces

writes the texts in `traces/`, which `test_flir_traces.py` compares with what the driver does. A line is the time at
which a call ended, s since the unit was opened, the call with its outcome, and what was sent meanwhile.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from ptu_drivers import AxisSettings, PtuError, Reading, UnitSettings
from ptu_drivers.flir.setup import connect
from ptu_drivers.simulated.flir import D_SERIES, FlirModel, LineEffect
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

FOLDER = Path(__file__).parent / "traces"
PAIR = FlirModel(combined=False, device_clock=False)


class Trace:
    """A unit on a virtual line, opened; its methods are the unit's, and are written down.

    Parameters
    ----------
    model, line : what is simulated. settings : of the driver. seed : of the latencies.
    """

    def __init__(
        self,
        model: FlirModel = PAIR,
        line: LineModel | None = None,
        settings: UnitSettings | None = None,
        *,
        seed: int = 5,
        echo: bool = True,
    ) -> None:
        self.peer = SimulatedUnit(model, line or LineModel(), seed=seed)
        self.peer.flir.echo = echo
        self.line = VirtualLine(self.peer, 9600 if self.peer.line.baud else 0, seed=seed)
        self.line.record = True
        self.rows: list[str] = []
        self._written = 0
        self.unit = connect(self.line, settings or UnitSettings())
        self._zero_s = self.line.now()
        self._note("open", self.unit.describe().details["baud"])

    def _note(self, call: str, outcome: str) -> None:
        """Write a call down, with what was sent since the last one."""
        sent = "".join(data.decode("ascii") for _, way, data in self.line.traffic[self._written :] if way == ">")
        self._written = len(self.line.traffic)
        row = f"{self.line.now() - self._zero_s:9.4f} {call} = {outcome}"
        self.rows.append(f"{row}: {sent}".rstrip() if sent else row)

    def _call(self, name: str, call: Callable[[], None]) -> None:
        try:
            call()
        except PtuError as fault:
            self._note(name, type(fault).__name__)
        else:
            self._note(name, "done")

    def read(self, times: int = 1) -> None:
        for _ in range(times):
            got = self.unit.read()
            if isinstance(got, Reading):
                angles = f"{got.pan.angle_rad:.5f} at {got.pan.t_s - self._zero_s:.4f}"
                self._note("read", f"{angles}, {got.tilt.angle_rad:.5f} at {got.tilt.t_s - self._zero_s:.4f}")
            else:
                self._note("read", f"{got.reason.value}, {got.state.value}")
                if not self.line.traffic[self._written :]:
                    self.line.settle(0.005)

    def read_for(self, duration_s: float) -> None:
        end = self.line.now() + duration_s
        while self.line.now() < end:
            self.read()

    def until_ready(self) -> None:
        """Read until there are angles."""
        while True:
            self.read()
            if self.unit.health().state.value == "ready" and " at " in self.rows[-1]:
                return

    def move_to(self, pan: float | None = None, tilt: float | None = None, rate: float | None = None) -> None:
        self._call(
            f"move_to {pan} {tilt} {rate}", lambda: self.unit.move_to(pan_rad=pan, tilt_rad=tilt, rate_rad_s=rate)
        )

    def move_at(self, pan: float, tilt: float = 0.0) -> None:
        self._call(f"move_at {pan} {tilt}", lambda: self.unit.move_at(pan_rad_s=pan, tilt_rad_s=tilt))

    def turn(self, pan: float, tilt: float = 0.0, times: int = 3, reads: int = 2) -> None:
        """Command a rate again and again, as a head in operation gets it."""
        for _ in range(times):
            self.move_at(pan, tilt)
            self.read(reads)

    def halt(self) -> None:
        self._call("halt", self.unit.halt)

    def home(self) -> None:
        self._call("home", self.unit.home)

    def settle(self, duration_s: float) -> None:
        """Let time pass on a line in any state."""
        self.line.settle(duration_s)

    def end(self) -> str:
        """Close the unit, and return all that was written down with the health and where the axes came to rest."""
        self._call("close", self.unit.close)
        self.settle(3.0)
        health = self.unit.health()
        failures = ", ".join(f"{reason.value} {n}" for reason, n in sorted(health.failures.items()))
        self.rows += [
            f"{health.state.value}, halt owed: {health.halt_owed}",
            f"exchanges {health.exchanges}, readings {health.readings}",
            f"resyncs {health.resyncs}, reconnects {health.reconnects}, restarts {health.restarts}, watchdog stops "
            f"{health.watchdog_stops}, limit events {health.limit_events}",
            f"failures: {failures or 'none'}",
        ]
        now = self.line.now()
        for letter, axis in self.peer.flir.axes.items():
            self.rows.append(f"{letter} stands at {axis.motor(now):.0f}, speed {axis.speed(now):.0f}")
        return "\n".join(self.rows) + "\n"


def start() -> str:
    """Found at its own speed and raised; the combined query, then the shutdown at rest."""
    trace = Trace(FlirModel(device_clock=False), LineModel(baud=19200), UnitSettings(baud=115200), echo=False)
    trace.read(3)
    return trace.end()


def start_with_a_clock() -> str:
    """A unit that stamps its angles."""
    trace = Trace(FlirModel())
    trace.move_to(0.3, rate=0.4)
    trace.read(6)
    return trace.end()


def restart_and_baud_recovery() -> str:
    """Power lost while it turns at 115200 bit/s: awaited at 9600 until it has homed, set up, and raised again."""
    trace = Trace(PAIR.replace(homing_s=4.0), settings=UnitSettings(baud=115200))
    trace.move_to(0.2, rate=0.3)
    trace.turn(0.2)
    trace.peer.power_cycle(trace.line.now(), 1.5)
    trace.until_ready()
    trace.read(2)
    trace.move_to(0.05)
    trace.read_for(0.3)
    return trace.end()


def power_dip_without_homing() -> str:
    """Back at once, verbose and without homing; a command comes meanwhile."""
    trace = Trace()
    trace.turn(0.2)
    trace.peer.power_cycle(trace.line.now(), 1.2, homing=False)
    trace.move_to(0.3)
    trace.until_ready()
    trace.turn(0.1, times=1)
    return trace.end()


def made_verbose() -> str:
    """Another program switched the texts on, and then the echo off."""
    trace = Trace()
    trace.turn(0.1)
    trace.peer.flir.verbose = True
    trace.until_ready()
    trace.turn(0.1, times=1)
    trace.peer.flir.echo = False
    trace.until_ready()
    trace.turn(0.1, times=1)
    return trace.end()


def rates_with_renewals() -> str:
    """Both axes, faster, the other way, one at rest; then no command, and the watchdog."""
    trace = Trace()
    trace.turn(0.2, 0.05, times=8)
    trace.turn(0.5, 0.05, times=4)
    trace.turn(-0.2, 0.0, times=6)
    trace.move_at(0.0, 0.0)
    trace.read(3)
    trace.turn(0.1, -0.02, times=2)
    trace.read_for(0.8)
    return trace.end()


def rates_without_reads() -> str:
    """The driver reads where it must know where a target lies, and not more."""
    trace = Trace(FlirModel(device_clock=False))
    for _ in range(12):
        trace.move_at(0.2, 0.02)
        trace.settle(0.08)
    trace.settle(0.7)
    trace.read(2)
    return trace.end()


def rates_of_a_slow_unit() -> str:
    """A D-series unit takes ten commands a second."""
    trace = Trace(D_SERIES, LineModel(commands_per_s=10))
    trace.turn(0.15, 0.1, times=4, reads=1)
    trace.move_to(0.1)
    trace.read(2)
    return trace.end()


def moves() -> str:
    """To positions: with a speed and without, a new target in motion, after motion by rate, of one axis."""
    trace = Trace()
    trace.move_to(0.3, 0.1)
    trace.read(4)
    trace.move_to(0.1, rate=0.5)
    trace.read(4)
    trace.turn(0.2, 0.1)
    trace.move_to(pan=0.4)
    trace.read(3)
    trace.turn(0.2, 0.1)
    trace.move_to()
    trace.read(3)
    trace.halt()
    trace.read(2)
    return trace.end()


def waits() -> str:
    """Answers that come late, and homing, which takes its time."""
    trace = Trace(PAIR.replace(homing_s=3.0))
    trace.move_to(0.3)
    trace.read(2)
    trace.peer.late_s.append(0.4)
    trace.read_for(0.8)
    trace.peer.late_s.append(0.3)
    trace.move_to(0.2)
    trace.read(5)
    trace.turn(0.1)
    trace.home()
    trace.read(2)
    trace.peer.late_s.append(0.3)
    trace.turn(0.1)
    return trace.end()


def limits() -> str:
    """What is beyond a limit, and an axis that is stopped before its soft limit while the other turns on."""
    soft = AxisSettings(sign=-1, zero_rad=0.02, low_rad=-0.3, high_rad=0.1, max_rate_rad_s=0.6)
    trace = Trace(settings=UnitSettings(pan=soft))
    trace.move_to(0.2)
    trace.move_to(0.05, -1.0)
    trace.move_to(0.05, rate=0.7)
    trace.move_to(0.05, rate=0.0)
    trace.move_at(0.7)
    trace.move_at(0.0001)
    trace.turn(0.3, -0.05, times=8)
    trace.move_at(-0.1)
    trace.read(2)
    trace.peer.say(trace.line.now(), b"!P!T\r\n")
    trace.read(2)
    return trace.end()


def refused() -> str:
    """The unit refuses the tilt's speed, then its renewals, then all."""
    trace = Trace()
    carry_out = trace.peer.flir.execute
    names: tuple[str, ...] = ("TS",)

    def refusing(command: str, t_s: float) -> LineEffect:
        name, digits = command.upper().rstrip("-0123456789"), command[2:]
        return carry_out("NONSENSE" if name in names and digits else command, t_s)

    trace.peer.flir.execute = refusing  # type: ignore[method-assign]
    trace.move_at(0.2, 0.1)
    trace.read(2)
    trace.turn(0.2, 0.0, times=2)
    names = ("PP",)
    trace.read_for(0.4)
    trace.move_to(0.1, 0.1)
    trace.read(2)
    names = ()
    trace.turn(0.2)
    return trace.end()


def halts() -> str:
    """At rest, in motion, and when an answer is late."""
    trace = Trace()
    trace.halt()
    trace.turn(0.3)
    trace.halt()
    trace.read(2)
    trace.move_to(0.5)
    trace.peer.late_s.append(0.4)
    trace.halt()
    trace.read(4)
    return trace.end()


def blind_halt() -> str:
    """The line is silent: a halt is sent before any query, and again when a reply arrives."""
    trace = Trace()
    trace.turn(0.3)
    trace.line.dead = True
    trace.read(1)
    trace.halt()
    trace.read(3)
    trace.line.dead = False
    trace.until_ready()
    trace.read(2)
    return trace.end()


def halt_in_doubt() -> str:
    """Noise before the halt: first blindly, then behind a question."""
    trace = Trace()
    trace.move_to(0.5, rate=0.3)
    trace.read(3)
    trace.peer.say(trace.line.now(), b"PP * 7\r\n")
    trace.read(1)
    trace.halt()
    trace.read(2)
    return trace.end()


def lost_line_by_rate() -> str:
    """Unplugged while it turns by rate; commands fail, and the motion is halted when the line is back."""
    trace = Trace()
    trace.turn(0.2, 0.05)
    trace.line.gone = True
    trace.move_at(0.2, 0.05)
    trace.read(2)
    trace.halt()
    trace.settle(0.3)
    trace.move_to(0.1)
    trace.line.gone = False
    trace.until_ready()
    trace.turn(0.1, times=2)
    return trace.end()


def lost_line_by_position() -> str:
    """The wire is dead for two seconds on the way to a position."""
    trace = Trace(settings=replace(UnitSettings(), baud=115200))
    trace.move_to(0.9, 0.2, rate=0.2)
    trace.read(2)
    trace.line.dead = True
    trace.read_for(2.0)
    trace.line.dead = False
    trace.until_ready()
    trace.read(2)
    return trace.end()


def network_line() -> str:
    """A socket with a banner, closed by the other side in motion."""
    trace = Trace(FlirModel(), LineModel(baud=0, banner="* PAN-TILT banner " * 4, banner_s=0.3))
    trace.turn(0.2, times=2)
    trace.line.gone = True
    trace.read(1)
    trace.line.gone = False
    trace.until_ready()
    trace.turn(0.2, times=2)
    trace.line.gone = True
    trace.halt()
    trace.line.gone = False
    trace.halt()
    return trace.end()


def noisy_line() -> str:
    """Lost and garbled bytes both ways, while it turns."""
    trace = Trace()
    trace.turn(0.1, 0.02, times=2)
    trace.line.faults.skip, trace.line.faults.lose = 4, 2
    trace.turn(0.1, 0.02, times=2)
    trace.line.faults.to_unit_lose = 1
    trace.turn(0.1, 0.02, times=2)
    trace.line.faults.skip, trace.line.faults.garble = 10, 3
    trace.turn(0.1, 0.02, times=2)
    trace.line.faults.merge = 1
    trace.turn(0.1, 0.02, times=2)
    trace.peer.baud = 19200
    trace.read(3)
    trace.peer.baud = 9600
    trace.until_ready()
    return trace.end()


def shutdown_after_rates() -> str:
    """The speeds of moves are given back."""
    trace = Trace()
    trace.move_to(0.0, rate=0.25)
    trace.turn(0.3, 0.1)
    return trace.end()


def shutdown_of_a_silent_line() -> str:
    """The halt is sent without an answer, and is owed."""
    trace = Trace()
    trace.turn(0.3)
    trace.line.dead = True
    return trace.end()


def shutdown_of_a_lost_line() -> str:
    """Nothing can be sent."""
    trace = Trace(D_SERIES, LineModel(commands_per_s=10))
    trace.move_to(0.5)
    trace.line.gone = True
    return trace.end()


SCENARIOS: Mapping[str, Callable[[], str]] = {
    scenario.__name__: scenario
    for scenario in (
        start,
        start_with_a_clock,
        restart_and_baud_recovery,
        power_dip_without_homing,
        made_verbose,
        rates_with_renewals,
        rates_without_reads,
        rates_of_a_slow_unit,
        moves,
        waits,
        limits,
        refused,
        halts,
        blind_halt,
        halt_in_doubt,
        lost_line_by_rate,
        lost_line_by_position,
        network_line,
        noisy_line,
        shutdown_after_rates,
        shutdown_of_a_silent_line,
        shutdown_of_a_lost_line,
    )
}

if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, scenario in SCENARIOS.items():
        (FOLDER / f"{name}.txt").write_text(scenario(), encoding="utf-8")
