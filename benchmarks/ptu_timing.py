"""How fast and how truly a FLIR unit is asked, in virtual time and on a pty: rates, instants, processor time.

The simulated unit has 2 to 8 ms of latency, turns at 2000 counts/s and shows six-character positions. In virtual
time nothing but the protocol counts, and that a port sends up to 1 ms late; on the pty, with the unit in a process of
its own, this machine counts too: the more it has to do besides, the worse. Figures in docs/notes/field.md.
"""

import argparse
import contextlib
import math
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ptu_drivers import Reading, UnitSettings
from ptu_drivers.flir.poll import Query
from ptu_drivers.flir.setup import connect, open_flir
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer

TERSE_PAIR_HZ = 36.9
RATE = 2000.0
USB_FRAME_S = 0.001
# query, baud raised to, period of an adapter's batches, network
CASES = (
    ("pair", 0, 0.0, False),
    ("pair", 0, 0.016, False),
    ("combined", 0, 0.0, False),
    ("device clock", 0, 0.0, False),
    ("device clock", 0, 0.016, False),
    ("pair", 115200, 0.0, False),
    ("combined", 115200, 0.0, False),
    ("device clock", 115200, 0.0, False),
    ("combined", 0, 0.0, True),
)


def in_virtual_time(query: str, baud: int, batch_s: float, network: bool) -> str:
    unit = SimulatedUnit(FlirModel(), LineModel(baud=0 if network else 9600), seed=5)
    line = VirtualLine(unit, 0 if network else 9600, batch_s=batch_s, send_delay_s=USB_FRAME_S)
    device = connect(line, UnitSettings(baud=baud), query=query)
    q = device.describe().pan.quantum_rad
    device.move_to(pan_rad=-25000 * q, tilt_rad=-4000 * q, rate_rad_s=8000 * q)
    line.wait(6.0)
    device.move_to(pan_rad=25000 * q, tilt_rad=13900 * q, rate_rad_s=RATE * q)
    line.wait(0.5)
    errors, stated, count, begun, seconds = [], [], 0, line.now(), 8.0
    while line.now() < begun + seconds:
        got = device.read()
        assert isinstance(got, Reading), got
        count += 1
        for s, letter in ((got.pan, "P"), (got.tilt, "T")):
            errors.append((round(s.angle_rad / q) - unit.flir.axes[letter].motor(s.t_s)) / RATE)
            stated.append(s.sigma_t_s)
    # a counter's rounding is no error of the instant
    rms = math.sqrt(max(0.0, statistics.fmean(e * e for e in errors) - 1 / 12 / RATE**2))
    return (
        f"{count / seconds:6.1f}/s   instants: rms {rms * 1e3:.2f} ms, mean {statistics.fmean(errors) * 1e3:+.2f}, "
        f"worst {max(map(abs, errors)) * 1e3:.2f}, stated {statistics.fmean(stated) * 1e3:.2f}"
    )


def on_a_pty(query: str, baud: int, seconds: float, hz: float) -> str:
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "unit"
        command = [sys.executable, "-m", "groundstation", "ptu", "simulate", "--link", str(link)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            server.stdout.readline()
            with open_flir(str(link), UnitSettings(baud=baud), query=query) as device:
                q = device.describe().pan.quantum_rad
                device.use_query(Query(query))
                device.move_to(pan_rad=-20000 * q, tilt_rad=-4000 * q)
                time.sleep(7.0)
                begun, spent, count = time.monotonic(), _processor_s(), 0
                while time.monotonic() < begun + seconds:
                    count += isinstance(device.read(), Reading)
                    if hz:
                        time.sleep(max(0.0, begun + count / hz - time.monotonic()))
                took = time.monotonic() - begun
                share = (_processor_s() - spent) / took
                failures = sum(device.health().failures.values())
            server.terminate()
    return f"{count / took:6.1f}/s   processor {100 * share:.1f} % of a core, failures {failures}"


def instants_on_a_pty(query: str, baud: int, seconds: float) -> str:
    """Compare stamps with the truth in real time; the unit is in a thread of this program, and slows it."""
    unit = SimulatedUnit(FlirModel(), LineModel(), seed=5)
    line = VirtualLine(unit, start_s=time.monotonic(), seed=5)
    with contextlib.ExitStack() as stack:
        link = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "unit"
        server = stack.enter_context(SimulatedServer(line, link))
        device = stack.enter_context(open_flir(str(link), UnitSettings(baud=baud), query=query))
        device.use_query(Query(query))
        q = device.describe().pan.quantum_rad
        device.move_to(pan_rad=25000 * q, rate_rad_s=RATE * q)
        time.sleep(0.5)
        errors, begun = [], time.monotonic()
        while time.monotonic() < begun + seconds:
            got = device.read()
            if isinstance(got, Reading):
                with server.lock:
                    truth = unit.flir.axes["P"].motor(got.pan.t_s)
                errors.append((round(got.pan.angle_rad / q) - truth) / RATE)
        device.halt()
    rms = math.sqrt(max(0.0, statistics.fmean(e * e for e in errors) - 1 / 12 / RATE**2))
    mean, worst = statistics.fmean(errors), max(map(abs, errors))
    return (
        f"{len(errors) / seconds:6.1f}/s   instants: rms {rms * 1e3:.2f} ms, mean {mean * 1e3:+.2f}, "
        f"worst {worst * 1e3:.2f}"
    )


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="on the pty, for each case")
    parser.add_argument("--pty-only", action="store_true", help="leave out virtual time")
    options = parser.parse_args()
    print(f"the line's limit for terse pairs at 9600 baud is {TERSE_PAIR_HZ}/s")
    for query, baud, batch_s, network in () if options.pty_only else CASES:
        line = "network" if network else f"{baud or 9600} baud"
        line += f", batches of {batch_s * 1e3:.0f} ms" if batch_s else ""
        print(f"virtual time  {query:12} {line:28} {in_virtual_time(query, baud, batch_s, network)}", flush=True)
    for query, baud, hz in (("pair", 0, 0), ("combined", 115200, 0), ("combined", 115200, 80)):
        line = f"{baud or 9600} baud" + (f", {hz} asked for" if hz else "")
        print(f"pty           {query:12} {line:28} {on_a_pty(query, baud, options.seconds, hz)}", flush=True)
    for query, baud in (("pair", 0), ("combined", 115200)):
        reported = instants_on_a_pty(query, baud, options.seconds)
        print(f"pty, thread   {query:12} {baud or 9600} baud {reported}", flush=True)


if __name__ == "__main__":
    main()
