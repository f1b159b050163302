"""Two Dynamixel servos keep the contract of a pan-tilt unit: simulated, in virtual time, behind the maker's SDK."""

import pytest

from ptu_drivers.dynamixel import DynamixelOptions, connect_dynamixel
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated_dynamixel import SimulatedDynamixel
from ptu_drivers.simulated_line import VirtualLine
from tests.contracts.pan_tilt_unit import ContractRig, PanTiltContract
from tests.peers import peer_module

peer_module("dynamixel-sdk", "dynamixel_sdk")


def dynamixel_rig(unit: SimulatedDynamixel) -> ContractRig:
    line = VirtualLine(unit, unit.baud)

    def set_dead(dead: bool) -> None:
        line.dead = dead

    return ContractRig(
        open=lambda settings: connect_dynamixel(line, settings, DynamixelOptions(), watch=False),
        now=line.now,
        wait=line.wait,
        truth=unit.head_rad,
        cut=lambda: set_dead(True),
        mend=lambda: set_dead(False),
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
