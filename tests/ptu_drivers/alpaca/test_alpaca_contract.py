"""A mount behind Alpaca keeps the contract of a pan-tilt unit: simulated, in virtual time."""

import math
from collections.abc import Callable

import pytest

from ptu_drivers import LeaseKind
from ptu_drivers.alpaca.unit import AlpacaOptions, connect_alpaca
from ptu_drivers.messages import Axis
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated.alpaca import MountModel, SimulatedMount
from ptu_drivers.simulated.http_server import VirtualHttp
from tests.contracts.pan_tilt_unit import ContractRig, PanTiltContract


def alpaca_rig(model: MountModel, settings: UnitSettings) -> ContractRig:
    mount = SimulatedMount(model)
    line = VirtualHttp(mount)

    def truth(axis: Axis, t_s: float) -> float:
        if axis is Axis.TILT:
            return math.radians(mount.altitude_deg(t_s))
        return -math.remainder(math.radians(mount.azimuth_deg(t_s)), 2 * math.pi)

    def sets(name: str, value: float) -> Callable[[], None]:
        return lambda: setattr(line, name, value)

    return ContractRig(
        open=lambda settings: connect_alpaca(
            line, settings, AlpacaOptions(altitude_low_deg=-10.0, altitude_high_deg=60.0), watch=False
        ),
        now=line.now,
        wait=line.wait,
        truth=truth,
        cut=sets("dead", True),
        mend=sets("dead", False),
        unplug=sets("gone", True),
        plug=sets("gone", False),
        trickle=lambda apart_s: setattr(line, "trickle_s", apart_s),
        at=line.at,
        lease=LeaseKind.NONE if model.alignment == 0 else LeaseKind.NO_RATES,
        settings=settings,
        time_sigma_s=0.0005,
    )


class TestAlpaca(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return alpaca_rig(MountModel(), UnitSettings())


class TestAlpacaBeforeVersionFour(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return alpaca_rig(MountModel(state=False), UnitSettings())


class TestAlpacaOnAnEquatorialMount(PanTiltContract):
    """Its axes are no pan and tilt: it slews to altitudes, but does not turn at rates."""

    @pytest.fixture
    def rig(self) -> ContractRig:
        return alpaca_rig(MountModel(alignment=2), UnitSettings())
