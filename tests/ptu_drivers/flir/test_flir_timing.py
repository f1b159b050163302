"""Rates and instants in virtual time: the limits of the line, the unit's latency and the driver's order of steps."""

import math

import pytest

from ptu_drivers import AngleSource, Axis, Reading, UnitSettings
from ptu_drivers.flir.setup import connect
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

# five digits and a sign, as a unit of 0.006 deg has them
START = -15000
TERSE_PAIR_HZ = 36.9
USB_FRAME_S = 0.001
LINE_SHARE = 0.8


def sweep(
    model: FlirModel, baud: int, batch_s: float = 0.0, seconds: float = 8.0, network: bool = False
) -> tuple[float, float, list[Reading]]:
    """Return readings/s, rms error of the instants in s, and the readings, turning at a steady 2000 counts/s."""
    unit = SimulatedUnit(model, LineModel(baud=0 if network else 9600), seed=11)
    line = VirtualLine(unit, 0 if network else 9600, batch_s=batch_s, send_delay_s=USB_FRAME_S)
    device = connect(line, UnitSettings(baud=baud))
    q = device.describe().pan.quantum_rad
    device.move_to(pan_rad=START * q, tilt_rad=-4000 * q, rate_rad_s=8000 * q)
    line.wait(5.0)
    device.move_to(pan_rad=15000 * q, tilt_rad=13000 * q, rate_rad_s=2000 * q)
    line.wait(0.5)
    readings, begun = [], line.now()
    while line.now() < begun + seconds:
        got = device.read()
        assert isinstance(got, Reading), got
        readings.append(got)
    errors = []
    for r in readings:
        for s, letter in ((r.pan, "P"), (r.tilt, "T")):
            axis = unit.flir.axes[letter]
            counts = round(s.angle_rad / q)
            # the instant at which the counter stood there, within half a count
            off = (counts - axis.motor(s.t_s)) / axis.speed(s.t_s)
            errors.append(math.copysign(max(0.0, abs(off) - 0.5 / 2000), off))
    return len(readings) / seconds, math.sqrt(sum(e * e for e in errors) / len(errors)), readings


PAIR = FlirModel(combined=False, device_clock=False)
COMBINED = FlirModel(device_clock=False)


def test_pairs_at_9600_baud() -> None:
    rate, rms, readings = sweep(PAIR, 0)
    assert rate >= LINE_SHARE * TERSE_PAIR_HZ
    assert rms <= 0.002
    assert readings[-1].pan.source is AngleSource.LAST_BYTE_SENT
    assert readings[-1].pan.t_s < readings[-1].tilt.t_s


def test_combined_at_115200_baud() -> None:
    rate, rms, _ = sweep(COMBINED, 115200)
    assert rate >= 80.0
    assert rms <= 0.002


@pytest.mark.parametrize(
    ("model", "network", "batch_s"),
    [(PAIR, False, 0.016), (FlirModel(), False, 0.0), (FlirModel(), False, 0.016), (PAIR, True, 0.0)],
    ids=["USB adapter", "device clock", "device clock behind a USB adapter", "network"],
)
def test_instants_on_other_lines(model: FlirModel, network: bool, batch_s: float) -> None:
    _, rms, readings = sweep(model, 0, batch_s, network=network)
    assert rms <= 0.002
    sigmas = [s.sigma_t_s for r in readings for s in (r.pan, r.tilt)]
    assert rms <= 3 * max(sigmas)


def test_a_device_clock_is_known_better_than_one_exchange() -> None:
    _, rms, readings = sweep(FlirModel(), 0)
    assert readings[-1].pan.source is AngleSource.DEVICE_CLOCK
    assert rms < 0.0007
    assert readings[-1].pan.t_s == readings[-1].tilt.t_s
    assert {s.axis for r in readings for s in (r.pan, r.tilt)} == set(Axis)


def test_an_echo_that_interrupts_replies_is_detected_and_avoided() -> None:
    line = VirtualLine(SimulatedUnit(PAIR, LineModel(echo_interrupts=True), seed=1))
    device = connect(line, UnitSettings())
    tried = device.health().failures
    assert all(isinstance(device.read(), Reading) for _ in range(50))
    assert device.health().failures == tried
