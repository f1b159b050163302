"""Two Dynamixel servos keep the contract of a pan-tilt unit: simulated, in virtual time, behind the maker's SDK."""

from collections.abc import Callable

import pytest

from ptu_drivers import LeaseKind
from ptu_drivers.dynamixel.unit import DynamixelOptions, connect_dynamixel
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated.dynamixel import SimulatedDynamixel
from ptu_drivers.simulated.line import VirtualLine
from tests.contracts.pan_tilt_unit import ContractRig, PanTiltContract
from tests.peers import peer_module

peer_module("dynamixel-sdk", "dynamixel_sdk")


def dynamixel_rig(unit: SimulatedDynamixel) -> ContractRig:
    line = VirtualLine(unit, unit.baud)

    def sets(name: str, value: float) -> Callable[[], None]:
        return lambda: setattr(line, name, value)

    return ContractRig(
        open=lambda settings: connect_dynamixel(line, settings, DynamixelOptions(), watch=False),
        now=line.now,
        wait=line.wait,
        truth=unit.head_rad,
        cut=sets("dead", True),
        mend=sets("dead", False),
        unplug=sets("gone", True),
        plug=sets("gone", False),
        trickle=lambda apart_s: setattr(line, "trickle_s", apart_s),
        at=line.at,
        lease=LeaseKind.UNIT_WATCHDOG,
        settings=UnitSettings(),
        time_sigma_s=0.0005,
    )


class TestDynamixel(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return dynamixel_rig(SimulatedDynamixel(seed=5))


class TestDynamixelWithEcho(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return dynamixel_rig(SimulatedDynamixel(seed=6, echo=True, baud=115200))
