"""Everything that goes wrong on a line: no wrong angle, no hang, back within two seconds.

The campaign itself is `benchmarks/ptu_faults.py`; here are its first runs, and each fault by itself.
"""

import random

import ptu_faults
import pytest

from ptu_drivers import (
    FailureReason,
    LimitError,
    NoReading,
    PanTiltUnit,
    ProtocolError,
    Reading,
    UnitSettings,
    UnitState,
)
from ptu_drivers.flir.setup import connect
from ptu_drivers.simulated.faults import FAULTS
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from tests.complaints import only


def opened(**line_model: object) -> tuple[PanTiltUnit, VirtualLine]:
    line = VirtualLine(SimulatedUnit(FlirModel(combined=False, device_clock=False), LineModel(**line_model), seed=3))
    return connect(line, UnitSettings()), line


@pytest.mark.parametrize("seed", range(25))
def test_campaign(seed: int) -> None:
    outcome = ptu_faults.run(seed)
    assert outcome.wrong == []
    assert outcome.longest_read_s <= outcome.allowed_read_s
    assert outcome.recovery_s <= ptu_faults.RECOVERY_S
    assert outcome.readings > 20


@pytest.mark.parametrize("name", list(FAULTS))
def test_each_fault_is_survived(name: str) -> None:
    """While it turns at a steady speed: readings before and after, all true, whatever happens in between."""
    device, line = opened()
    device.move_to(pan_rad=2.5, rate_rad_s=0.1)
    rnd, outcome = random.Random(f"{name} 1"), ptu_faults.Outcome(seed=0)
    for _ in range(3):
        lasts = FAULTS[name](line, rnd)
        end = line.now() + lasts + ptu_faults.RECOVERY_S
        while line.now() < end or (line.unit.flir.axes["P"].end_s() > line.now() and name == "power cycle"):
            got = device.read()
            if isinstance(got, Reading):
                ptu_faults.check(line.unit, device, got, outcome)
        assert isinstance(got, Reading)
    assert outcome.wrong == []
    assert device.health().state is UnitState.READY


def test_a_late_reply_is_never_taken_for_the_next() -> None:
    """The unit replies 0.4 s late, after the query was aborted and repeated: the old reply is discarded."""
    device, line = opened()
    device.move_to(pan_rad=2.5)
    assert isinstance(device.read(), Reading)
    line.unit.late_s.append(0.4)
    outcome = ptu_faults.Outcome(seed=0)
    got = [device.read() for _ in range(30)]
    assert isinstance(got[0], NoReading)
    assert got[0].reason is FailureReason.TIMEOUT
    for reading in got:
        if isinstance(reading, Reading):
            ptu_faults.check(line.unit, device, reading, outcome)
    assert outcome.wrong == []
    assert sum(isinstance(g, Reading) for g in got) > 20


def test_replies_shifted_by_one_are_found_at_once() -> None:
    """One reply too many in the line: never taken, whether it echoes a query, a set, or nothing."""
    for text in (b"PP * 1234\r\n", b"PP1000 *\r\n", b"* 1234\r\n", b"tp * 5\r\n"):
        device, line = opened()
        assert isinstance(device.read(), Reading)
        line.unit.say(line.now() + 0.002, text)
        for _ in range(10):
            got = device.read()
            if isinstance(got, Reading):
                assert got.pan.angle_rad == got.tilt.angle_rad == 0.0
        assert isinstance(got, Reading)


def test_an_angle_that_it_cannot_have_turned_to() -> None:
    """A digit lost on the way: 1200 becomes 120. Refused, and the next ones are true again."""
    device, line = opened()
    device.move_to(pan_rad=1200 * device.describe().pan.quantum_rad)
    line.wait(3.0)
    for _ in range(5):
        assert isinstance(device.read(), Reading)
    line.faults.skip, line.faults.lose = 6, 1
    readings = [got for _ in range(10) if isinstance(got := device.read(), Reading)]
    assert {round(r.pan.angle_rad / device.describe().pan.quantum_rad) for r in readings} == {1200}
    failures = device.health().failures
    assert failures.keys() & {FailureReason.TOO_FAST, FailureReason.UNCONFIRMED, FailureReason.OUT_OF_RANGE}


def test_unplugged_in_motion_it_is_halted_when_the_line_is_back() -> None:
    device, line = opened()
    device.move_to(pan_rad=2.5, rate_rad_s=0.1)
    line.wait(0.5)
    line.gone = True
    assert isinstance(device.read(), NoReading)
    assert device.health().state is UnitState.LINE_LOST
    line.settle(1.0)
    line.gone = False
    while not isinstance(device.read(), Reading):
        line.wait(0.01)
    line.wait(0.5)
    assert line.unit.flir.axes["P"].end_s() < line.now()
    assert line.unit.flir.axes["P"].motor(line.now()) < 2000


def test_a_power_cycle_with_homing_is_waited_for() -> None:
    device, line = opened()
    assert isinstance(device.read(), Reading)
    line.unit.power_cycle(line.now(), 1.0)
    began = line.now()
    while not isinstance(device.read(), Reading):
        assert line.now() - began < 60.0
    assert line.now() >= line.unit.homed_s
    assert line.now() - line.unit.homed_s < ptu_faults.RECOVERY_S
    assert device.health().restarts == 1


def test_motion_by_rate_is_halted_when_commands_stop() -> None:
    device, line = opened()
    device.move_at(pan_rad_s=0.2, tilt_rad_s=0.0)
    end = line.now() + 1.5
    while line.now() < end:
        device.read()
    assert line.unit.flir.axes["P"].speed(line.now()) == 0.0
    assert device.health().watchdog_stops == 1


def test_motion_by_rate_stops_before_a_soft_limit() -> None:
    device, line = opened()
    soft = device.describe().tilt.low_rad
    end = line.now() + 6.0
    while line.now() < end:
        with only(LimitError) as reported:
            device.move_at(pan_rad_s=0.0, tilt_rad_s=-0.3)
        if reported:
            assert "lower limit" in reported[0]
            break
        for _ in range(3):
            device.read()
    else:
        raise AssertionError("it was never refused")
    line.wait(1.0)
    tilt = line.unit.flir.axes["T"].motor(line.now()) * device.describe().tilt.quantum_rad
    assert soft <= tilt < soft + 0.1


def test_no_unit_and_another_device() -> None:
    unit = SimulatedUnit()
    line = VirtualLine(unit)
    line.dead = True
    with pytest.raises(ProtocolError, match=r"silence|nothing to .* wanted a FLIR unit's answer within 2 s"):
        connect(line, UnitSettings(), patience_s=2.0)


@pytest.mark.parametrize("baud", [115200, 19200])
def test_found_at_another_speed_without_echo_and_verbose(baud: int) -> None:
    unit = SimulatedUnit(line=LineModel(baud=baud))
    unit.flir.echo = False
    device = connect(VirtualLine(unit), UnitSettings())
    assert isinstance(device.read(), Reading)
    assert device.describe().details["baud"] == str(baud)


def test_a_d_series_unit_gets_ten_commands_a_second() -> None:
    from ptu_drivers.simulated.flir import D_SERIES

    unit = SimulatedUnit(D_SERIES, LineModel(commands_per_s=10))
    line = VirtualLine(unit)
    device = connect(line, UnitSettings())
    assert all(isinstance(device.read(), Reading) for _ in range(20))
    assert unit.lost_commands == 0
