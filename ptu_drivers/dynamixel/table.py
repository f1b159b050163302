"""Control table of Dynamixel's X series: where each number stands, and what one unit of it is.

The whole series (and MX with Protocol 2.0) shares these addresses and 4096 steps a turn; other series do not, and a
model that is not listed here is refused.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Register:
    """Address and size in bytes; signed numbers are two's complement, little end first."""

    address: int
    size: int
    signed: bool = False


MODEL_NUMBER = Register(0, 2)
FIRMWARE = Register(6, 1)
RETURN_DELAY = Register(9, 1)
DRIVE_MODE = Register(10, 1)
OPERATING_MODE = Register(11, 1)
VELOCITY_LIMIT = Register(44, 4)
MAX_POSITION = Register(48, 4)
MIN_POSITION = Register(52, 4)
TORQUE_ENABLE = Register(64, 1)
STATUS_RETURN = Register(68, 1)
HARDWARE_ERROR = Register(70, 1)
BUS_WATCHDOG = Register(98, 1, signed=True)
GOAL_VELOCITY = Register(104, 4, signed=True)
PROFILE_ACCELERATION = Register(108, 4)
PROFILE_VELOCITY = Register(112, 4)
GOAL_POSITION = Register(116, 4, signed=True)
REALTIME_TICK = Register(120, 2)
PRESENT_VELOCITY = Register(128, 4, signed=True)
PRESENT_POSITION = Register(132, 4, signed=True)
# tick, moving, load, velocity and position stand side by side: one read gives the angle and its instant
STATE = Register(120, 16)

TICKS = 32768  # the tick counts milliseconds from 0 to 32767
TICK_S = 0.001
WATCHDOG_S = 0.02
RETURN_DELAY_S = 2e-6
RATE_RAD_S = 0.229 * 2 * math.pi / 60


class OperatingMode(IntEnum):
    """The controlled quantity of a servo."""

    VELOCITY = 1
    POSITION = 3


HARDWARE_ERRORS = MappingProxyType(
    {0: "input voltage", 2: "overheating", 3: "motor encoder", 4: "electrical shock", 5: "overload"}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """One model: name, steps a turn, and the step at which the driver's zero is."""

    name: str
    steps: int = 4096
    zero: int = 2048


MODELS = MappingProxyType(
    {
        number: Model(name=name)
        for number, name in {
            30: "MX-28(2.0)",
            311: "MX-64(2.0)",
            321: "MX-106(2.0)",
            1000: "XH430-W350",
            1001: "XD430-T350",
            1010: "XH430-W210",
            1011: "XD430-T210",
            1020: "XM430-W350",
            1030: "XM430-W210",
            1040: "XH430-V350",
            1050: "XH430-V210",
            1060: "XL430-W250",
            1070: "XC430-W150",
            1080: "XC430-W240",
            1090: "2XL430-W250",
            1100: "XH540-W270",
            1101: "XD540-T270",
            1110: "XH540-W150",
            1111: "XD540-T150",
            1120: "XM540-W270",
            1130: "XM540-W150",
            1140: "XH540-V270",
            1150: "XH540-V150",
            1160: "2XC430-W250",
            1170: "XW540-T260",
            1180: "XW540-T140",
            1190: "XL330-M077",
            1200: "XL330-M288",
            1210: "XC330-T181",
            1220: "XC330-T288",
            1230: "XC330-M181",
            1240: "XC330-M288",
            1270: "XW430-T333",
            1310: "XW540-H260",
        }.items()
    }
)


def hardware_errors(bits: int) -> str:
    """Return the names of the set bits of the hardware error status, "" for none."""
    return ", ".join(HARDWARE_ERRORS.get(bit, f"bit {bit}") for bit in range(8) if bits >> bit & 1)


def number(data: bytes, *, signed: bool = False) -> int:
    """Return the number in these bytes."""
    return int.from_bytes(data, "little", signed=signed)
