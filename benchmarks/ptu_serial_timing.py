"""How true the stamps of Pelco and Dynamixel angles are, and how often both axes can be asked, in virtual time.

python benchmarks/ptu_serial_timing.py
"""

import math

import numpy as np
from ptu_serial_faults import SimulatedLink

from ptu_drivers.dynamixel.unit import DynamixelOptions, connect_dynamixel
from ptu_drivers.messages import Axis, Reading
from ptu_drivers.pelco.unit import PelcoOptions, connect_pelco
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated.dynamixel import SimulatedDynamixel
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco

_LASTS_S = 20.0


def main() -> None:
    """Print a line for each unit and speed."""
    for baud in (2400, 4800, 9600):
        unit = SimulatedPelco(PelcoModel(baud=baud), seed=1)
        line = VirtualLine(unit, baud)
        options = PelcoOptions(max_rate_deg_s=60.0, max_acceleration_deg_s2=120.0)
        driver = connect_pelco(line, UnitSettings(), options, unit.model.framing, watch=False)
        _report(f"pelco-d at {baud}", SimulatedLink(driver, unit, line, math.radians(60.0)))
    for baud in (57600, 115200, 1_000_000):
        servos = SimulatedDynamixel(baud=baud, seed=1)
        line = VirtualLine(servos, baud)
        both = connect_dynamixel(line, UnitSettings(), DynamixelOptions(), watch=False)
        _report(f"dynamixel at {baud}", SimulatedLink(both, servos, line, 1.0))


def _report(name: str, bench: SimulatedLink) -> None:
    line, errors_s, scaled, readings = bench.line, [], [], 0
    begun, side = line.now(), 1
    turn_s = begun
    while line.now() < begun + _LASTS_S:
        if line.now() >= turn_s:
            bench.unit.move_to(pan_rad=side * 1.5, tilt_rad=side * 1.5)
            side, turn_s = -side, line.now() + 2.5
        got = bench.unit.read()
        if not isinstance(got, Reading):
            continue
        readings += 1
        for s in (got.pan, got.tilt):
            before, after = (bench.sim.head_rad(s.axis, s.t_s + d) for d in (-0.005, 0.005))
            rate = (after - before) / 0.01
            if s.axis is Axis.TILT and abs(rate) > 0.6:
                error_s = (s.angle_rad - bench.sim.head_rad(s.axis, s.t_s)) / rate
                errors_s.append(error_s)
                scaled.append(error_s / math.hypot(s.sigma_t_s, s.sigma_rad / rate))
    rms = 1e3 * math.sqrt(np.mean(np.square(errors_s)))
    print(
        f"{name}: {readings / (line.now() - begun):.1f} readings/s, stamps (with the angle's step) {rms:.2f} ms rms, "
        f"mean {1e3 * np.mean(errors_s):+.2f} ms, {np.sqrt(np.mean(np.square(scaled))):.2f} of their sigma"
    )


if __name__ == "__main__":
    main()
