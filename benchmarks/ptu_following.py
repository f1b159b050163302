"""How well a FLIR unit follows by rate, in virtual time: a sine, and a creep slower than a count in a reading.

    python benchmarks/ptu_following.py

The loop is that of a head in operation: read, and command a rate where it has changed by 0.01 °/s or is 0.15 s old.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ptu_drivers import Reading, UnitSettings
from ptu_drivers.flir.setup import connect
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.simulated.flir import D_SERIES, FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

SECONDS, SETTLED_S, RENEW_S = 30.0, 3.0, 0.15
CHANGED_RAD_S = math.radians(0.01)
PAIR = FlirModel(combined=False, device_clock=False)
COMBINED = FlirModel(device_clock=False)
FINE = FlirModel(combined=False, device_clock=False, arcsec=23.142857, min_rate=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A unit on a line, and a pan angle to follow with a gain per second: rad and rad/s of a time in s."""

    name: str
    model: FlirModel
    line: LineModel
    angle_rad: Callable[[float], float]
    rate_rad_s: Callable[[float], float]
    raise_to: int = 0
    gain_per_s: float = 2.0


def sine(amplitude_deg: float, period_s: float) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Return a sine's angle and rate."""
    amplitude, pulse = math.radians(amplitude_deg), math.tau / period_s
    return (lambda t: amplitude * math.sin(pulse * t)), (lambda t: amplitude * pulse * math.cos(pulse * t))


def creep(rate_deg_s: float) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Return a steady rate's angle and rate."""
    rate = math.radians(rate_deg_s)
    return (lambda t: rate * t), (lambda _: rate)


def wanted_rate(unit: PanTiltUnit, case: Case, reading: Reading, t_s: float, zero_s: float, lead_s: float) -> float:
    """Return the rate that brings the pan axis to where it should be, rad/s, as the unit can turn."""
    about = unit.describe().pan
    seen_s = reading.pan.t_s - zero_s
    off = case.angle_rad(seen_s) - reading.pan.angle_rad
    rate = case.rate_rad_s(t_s + lead_s) + case.gain_per_s * off
    if abs(rate) < 0.5 * about.min_rate_rad_s:
        return 0.0
    return math.copysign(min(max(abs(rate), about.min_rate_rad_s), 0.99 * about.max_rate_rad_s), rate)


def follow(case: Case) -> str:
    """Return the errors of one run, and how often a second it was read and commanded."""
    simulated = SimulatedUnit(case.model, case.line, seed=7)
    line = VirtualLine(simulated, 9600)
    unit = connect(line, UnitSettings(baud=case.raise_to))
    quantum, zero_s = unit.describe().pan.quantum_rad, line.now()
    errors: list[float] = []
    readings = commands = 0
    lead_s, sent_rate, sent_s = 0.03, math.inf, -math.inf
    while (t_s := line.now() - zero_s) < SECONDS:
        reading = unit.read()
        if isinstance(reading, Reading):
            readings += 1
            t_s = line.now() - zero_s
            rate = wanted_rate(unit, case, reading, t_s, zero_s, lead_s)
            if abs(rate - sent_rate) > CHANGED_RAD_S or t_s - sent_s > RENEW_S:
                unit.move_at(pan_rad_s=rate, tilt_rad_s=0.0)
                sent_rate, sent_s = rate, line.now() - zero_s
                lead_s += 0.1 * (sent_s - t_s - lead_s)
                commands += 1
        t_s = line.now() - zero_s
        if t_s > SETTLED_S:
            errors.append(simulated.flir.axes["P"].motor(line.now()) * quantum - case.angle_rad(t_s))
    unit.close()
    rms = math.degrees(math.sqrt(sum(e * e for e in errors) / len(errors)))
    most = math.degrees(max(map(abs, errors)))
    return (
        f"{case.name}: rms {rms:.4f}°, most {most:.4f}°, {readings / SECONDS:.1f} readings and "
        f"{commands / SECONDS:.1f} commands a second"
    )


def cases() -> list[Case]:
    """Return the followed motions."""
    found = []
    for amplitude, period in ((20.0, 20.0), (5.0, 10.0), (0.5, 20.0)):
        angle, rate = sine(amplitude, period)
        moved: dict[str, Any] = {"angle_rad": angle, "rate_rad_s": rate}
        peak = f"{amplitude * math.tau / period:.1f} °/s at most"
        found += [
            Case(name=f"E series, 9600 baud, PP and TP, {peak}", model=PAIR, line=LineModel(), **moved),
            Case(name=f"E series, 115200 baud, B, {peak}", model=COMBINED, line=LineModel(), raise_to=115200, **moved),
            Case(
                name=f"D series, ten commands a second, {peak}",
                model=D_SERIES,
                line=LineModel(commands_per_s=10),
                gain_per_s=0.7,
                **moved,
            ),
        ]
    angle, rate = creep(0.02)
    return [*found, Case(name="creep of 0.02 °/s", model=FINE, line=LineModel(), angle_rad=angle, rate_rad_s=rate)]


def main() -> None:
    """Print them."""
    for case in cases():
        print(follow(case), flush=True)


if __name__ == "__main__":
    main()
