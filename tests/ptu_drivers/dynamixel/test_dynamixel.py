"""Two servos through the maker's SDK: accepted replies, settings, refusals, and the end."""

import builtins
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ptu_drivers import open_ptu
from ptu_drivers.dynamixel import table
from ptu_drivers.dynamixel.unit import DynamixelOptions, DynamixelUnit, connect_dynamixel
from ptu_drivers.errors import LimitError, MissingPackageError, NoAnswerError, ProtocolError, RefusedError
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import AngleSource, Axis, NoReading, Reading
from ptu_drivers.settings import AxisSettings, UnitSettings
from ptu_drivers.simulated.dynamixel import ServoModel, SimulatedDynamixel
from ptu_drivers.simulated.line import VirtualLine
from tests.peers import peer_module
from tests.ptu_drivers.served import served, transcript

dynamixel_sdk = peer_module("dynamixel-sdk", "dynamixel_sdk")

# the SDK's ping, a read of the model number, torque on, a goal of 2148, and a sync read of both positions there
TRANSCRIPT = """\
> FF FF FD 00 01 03 00 01 19 4E
< FF FF FD 00 01 07 00 55 00 FC 03 2E 1D 43
> FF FF FD 00 01 06 00 03 40 00 01 DB 66
< FF FF FD 00 01 04 00 55 00 A1 0C
> FF FF FD 00 01 09 00 03 74 00 64 08 00 00 50 59
< FF FF FD 00 01 04 00 55 00 A1 0C
> FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA
< FF FF FD 00 01 08 00 55 00 64 08 00 00 0E E8 FF FF FD 00 02 08 00 55 00 00 08 00 00 BC 32"""


def rig(model: ServoModel | None = None) -> tuple[SimulatedDynamixel, VirtualLine]:
    sim = SimulatedDynamixel(model, seed=3)
    return sim, VirtualLine(sim, sim.baud)


def connect(line: VirtualLine, settings: UnitSettings | None = None, **options: Any) -> DynamixelUnit:
    return connect_dynamixel(line, settings or UnitSettings(), DynamixelOptions(**options), watch=False)


def reading(unit: DynamixelUnit) -> Reading:
    got = unit.read()
    assert isinstance(got, Reading), got
    return got


def test_the_makers_sdk_drives_the_simulated_servos_over_a_pseudo_terminal(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # it waits for 34 ms, which a busy machine may take for itself
    monkeypatch.setattr(dynamixel_sdk.port_handler, "LATENCY_TIMER", 1000)
    sim = SimulatedDynamixel(ServoModel(acceleration_deg_s2=60_000.0, velocity_limit=2000), seed=3)
    with served(sim, tmp_path / "unit") as line:
        port = dynamixel_sdk.PortHandler(str(tmp_path / "unit"))
        assert port.openPort()
        assert port.setBaudRate(57600)
        ph = dynamixel_sdk.PacketHandler(2.0)
        assert ph.ping(port, 1) == (1020, dynamixel_sdk.COMM_SUCCESS, 0)
        assert ph.write1ByteTxRx(port, 1, 64, 1) == (dynamixel_sdk.COMM_SUCCESS, 0)
        assert ph.write4ByteTxRx(port, 1, 116, 2148) == (dynamixel_sdk.COMM_SUCCESS, 0)
        while sim.servo(Axis.PAN).axis.counter(time.monotonic()) != 100:
            time.sleep(0.005)
        sync = dynamixel_sdk.GroupSyncRead(port, ph, 132, 4)
        assert sync.addParam(1)
        assert sync.addParam(2)
        assert sync.txRxPacket() == dynamixel_sdk.COMM_SUCCESS
        assert (sync.getData(1, 132, 4), sync.getData(2, 132, 4)) == (2148, 2048)
        spoken = transcript(line)
        # beyond the limit, a register that is closed, an unknown instruction
        assert ph.write4ByteTxRx(port, 1, 116, 4000)[1] == 4
        assert ph.write1ByteTxRx(port, 1, 11, 1)[1] == 7
        assert ph.write1ByteTxRx(port, 1, 140, 1)[1] == 7
        assert ph.factoryReset(port, 1, 0xFF)[1] == 2
        port.closePort()
    assert spoken == TRANSCRIPT


def test_our_driver_over_a_pseudo_terminal(tmp_path: Path) -> None:
    sim = SimulatedDynamixel(ServoModel(acceleration_deg_s2=60_000.0, velocity_limit=500), seed=4)
    with served(sim, tmp_path / "unit"), open_ptu(str(tmp_path / "unit"), "dynamixel") as unit:
        assert unit.describe().model == "XM430-W350"
        unit.move_to(pan_rad=0.5, tilt_rad=-0.3)
        end = time.monotonic() + 5
        while time.monotonic() < end:
            got = unit.read()
            if isinstance(got, Reading) and abs(got.pan.angle_rad - 0.5) < 0.002:
                break
        assert abs(sim.head_rad(Axis.PAN, time.monotonic()) - 0.5) < 0.002
    assert sim.servo(Axis.PAN).get(table.TORQUE_ENABLE) == 0


def test_the_model_gives_the_step_and_the_servo_its_limits() -> None:
    _, line = rig(ServoModel(limits_deg=(-30.0, 60.0), velocity_limit=100))
    reported = connect(line).describe()
    assert reported.model == "XM430-W350"
    assert reported.pan.quantum_rad == 2 * math.pi / 4096
    assert math.degrees(reported.pan.low_rad) == pytest.approx(-30, abs=0.05)
    assert math.degrees(reported.tilt.high_rad) == pytest.approx(60, abs=0.05)
    assert reported.pan.max_rate_rad_s == pytest.approx(100 * 0.229 * 2 * math.pi / 60)


def test_instants_are_the_servos_own() -> None:
    """1 ms of tick: better than half a millisecond rms at 57600 baud, and consistent with the stamps' sigma."""
    sim, line = rig()
    unit = connect(line)
    unit.move_to(pan_rad=1.5, tilt_rad=1.0)
    scaled = []
    end = line.now() + 1.5
    while line.now() < end:
        got = reading(unit)
        for s in (got.pan, got.tilt):
            assert s.source is AngleSource.DEVICE_CLOCK
            rate = sim.servo(s.axis).axis.speed(s.t_s) * 2 * math.pi / 4096
            if abs(rate) > 0.5:
                error_s = (s.angle_rad - sim.head_rad(s.axis, s.t_s)) / rate
                assert abs(error_s) < 0.0015 + s.sigma_rad * 2 / abs(rate)
                scaled.append(error_s)
    assert len(scaled) > 50
    assert math.sqrt(sum(e * e for e in scaled) / len(scaled)) < 0.0007


def test_a_power_cycle_is_found_by_the_tick() -> None:
    sim, line = rig()
    unit = connect(line)
    unit.move_to(pan_rad=0.3)
    line.wait(2.0)
    sim.power_cycle(line.now(), 0.02)
    line.wait(0.1)
    assert sim.servo(Axis.PAN).get(table.TORQUE_ENABLE) == 0
    got = [unit.read() for _ in range(4)]
    assert isinstance(got[0], NoReading)
    assert isinstance(got[-1], Reading)
    assert unit.health().restarts == 1
    unit.move_to(pan_rad=-0.3)
    line.wait(2.0)
    assert reading(unit).pan.angle_rad == pytest.approx(-0.3, abs=0.002)


def test_an_old_reply_is_refused_by_its_tick() -> None:
    sim, line = rig()
    line.record = True
    unit = connect(line)
    unit.move_to(pan_rad=1.0)
    line.wait(0.3)
    before = len(line.traffic)
    reading(unit)
    old = b"".join(data for _, way, data in line.traffic[before:] if way == "<")
    line.wait(0.2)
    # the servos fall silent for one question, and the old answer comes in their place
    line.faults.to_unit_lose = 16
    sim.say(line.now() + 0.004, old)
    got = unit.read()
    assert isinstance(got, NoReading)
    assert got.reason is FailureReason.ECHO_MISMATCH
    late = reading(unit)
    assert late.pan.angle_rad == pytest.approx(sim.head_rad(Axis.PAN, late.pan.t_s), abs=0.003)


def test_a_hardware_error_is_named_and_refuses_motion() -> None:
    sim, line = rig()
    unit = connect(line)
    sim.servo(Axis.TILT).put(table.HARDWARE_ERROR, 0x20)
    assert isinstance(unit.read(), Reading)
    with pytest.raises(RefusedError, match=r"torque of tilt.*hardware error: overload"):
        unit.move_to(pan_rad=0.1)


def test_an_error_of_the_encoder_gives_no_angle() -> None:
    sim, line = rig()
    unit = connect(line)
    sim.servo(Axis.PAN).put(table.HARDWARE_ERROR, 0x08)
    got = unit.read()
    assert isinstance(got, NoReading)
    assert got.reason is FailureReason.REFUSED


def test_the_servos_stop_by_themselves_when_the_line_dies() -> None:
    sim, line = rig()
    unit = connect(line, UnitSettings(watchdog_s=0.2))
    unit.move_at(pan_rad_s=0.5, tilt_rad_s=0.0)
    line.wait(0.1)
    line.dead = True
    line.settle(1.0)
    assert sim.servo(Axis.PAN).axis.speed(line.now()) == 0
    assert sim.head_rad(Axis.PAN, line.now()) < 0.25
    line.dead = False
    while not isinstance(unit.read(), Reading):
        pass
    unit.move_at(pan_rad_s=-0.5, tilt_rad_s=0.0)
    line.wait(0.15)
    assert sim.servo(Axis.PAN).axis.speed(line.now()) < 0


@pytest.mark.parametrize(("watchdog_s", "lease_s"), [(0.2, 0.2), (0.5, 0.5), (60.0, 0.5), (0.0, 0.5)])
def test_the_servos_own_watchdog_has_the_lease_whatever_ours_has(watchdog_s: float, lease_s: float) -> None:
    """The driver's watchdog may be off or slow; a dead host is different. Queries renew the servo's watchdog."""
    sim, line = rig()
    unit = connect(line, UnitSettings(watchdog_s=watchdog_s))
    assert unit.describe().lease.renewed_s == lease_s
    unit.move_at(pan_rad_s=0.3, tilt_rad_s=0.0)
    for axis in Axis:
        assert sim.servo(axis).get(table.BUS_WATCHDOG) == round(lease_s / 0.02)
    if watchdog_s != lease_s:
        for _ in range(20):
            line.wait(0.1)
            reading(unit)
        assert sim.servo(Axis.PAN).axis.speed(line.now()) != 0
    last_s = sim.servo(Axis.PAN).heard_s
    line.wait(1.5)
    pan = sim.servo(Axis.PAN)
    assert pan.get(table.BUS_WATCHDOG) == -1
    assert pan.axis.speed(last_s + lease_s - 0.01) != 0
    assert pan.axis.speed(last_s + lease_s + 0.1) == 0
    # closed goals are opened again by the next command, and a move to a position has no watchdog
    unit.move_to(pan_rad=0.0)
    assert pan.get(table.BUS_WATCHDOG) == 0
    line.wait(3.0)
    assert sim.head_rad(Axis.PAN, line.now()) == pytest.approx(0.0, abs=0.002)


def test_a_halt_without_a_reply_works_in_both_modes() -> None:
    for by_rate in (True, False):
        sim, line = rig()
        unit = connect(line)
        reading(unit)
        if by_rate:
            unit.move_at(pan_rad_s=0.3, tilt_rad_s=0.2)
        else:
            unit.move_to(pan_rad=1.0, tilt_rad=0.5)
        line.wait(0.2)
        reading(unit)
        line.trickle_s = 10.0
        asked = line.now()
        with pytest.raises(NoAnswerError):
            unit.halt()
        for axis in Axis:
            # one braking from 60 deg/s, and back to where it was seen last
            assert sim.servo(axis).axis.speed(asked + 0.4) == 0
            assert abs(sim.head_rad(axis, line.now()) - sim.head_rad(axis, asked)) < 0.03


def test_rates_end_at_the_limit_and_below_the_slowest_are_refused() -> None:
    sim, line = rig()
    unit = connect(line, UnitSettings(pan=AxisSettings(low_rad=-0.4, high_rad=0.4)))
    with pytest.raises(LimitError, match="minimum speed"):
        unit.move_at(pan_rad_s=0.01, tilt_rad_s=0.0)

    def on_and_on() -> None:
        for _ in range(100):
            unit.move_at(pan_rad_s=0.5, tilt_rad_s=0.0)
            line.wait(0.03)

    with pytest.raises(LimitError, match=r"pan.*upper limit"):
        on_and_on()
    line.settle(0.5)
    assert 0.2 < sim.head_rad(Axis.PAN, line.now()) < 0.4


@pytest.mark.parametrize(("off", "torque"), [(True, 0), (False, 1)])
def test_closing_stops_and_releases_the_torque(off: bool, torque: int) -> None:
    sim, line = rig()
    with connect(line, torque_off=off) as unit:
        unit.move_at(pan_rad_s=0.5, tilt_rad_s=0.2)
        line.wait(0.1)
    line.settle(1.0)
    for axis in Axis:
        assert sim.servo(axis).axis.speed(line.now()) == 0
        assert sim.servo(axis).get(table.TORQUE_ENABLE) == torque


@pytest.mark.parametrize(
    ("spoil", "reported"),
    [
        (lambda sim: sim.servo(Axis.PAN).put(table.MODEL_NUMBER, 350), "model number 350 of servo 1"),
        (lambda sim: sim.servo(Axis.TILT).put(table.DRIVE_MODE, 4), "servo 2: got a time-based profile"),
        (lambda sim: sim.servos.pop(2), "no status packet.* from servo 2 at 57600.*tilt servo"),
    ],
)
def test_what_cannot_be_driven_is_named(spoil: Callable[[SimulatedDynamixel], object], reported: str) -> None:
    sim, line = rig()
    spoil(sim)
    with pytest.raises(ProtocolError, match=reported):
        connect(line)


def test_without_the_sdk_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "dynamixel_sdk":
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    _, line = rig()
    with pytest.raises(MissingPackageError, match=r"groundstation\[dynamixel\]"):
        connect(line)


def test_two_servos_have_two_identifiers() -> None:
    with pytest.raises(ProtocolError, match="two identifiers"):
        DynamixelOptions(pan_id=1, tilt_id=1)
    with pytest.raises(ProtocolError, match="tilt_id: got 254"):
        DynamixelOptions(tilt_id=254)
