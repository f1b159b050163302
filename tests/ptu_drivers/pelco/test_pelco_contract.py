"""Pelco units keep the contract of a pan-tilt unit: simulated, in virtual time."""

from collections.abc import Callable

import pytest

from ptu_drivers import LeaseKind
from ptu_drivers.pelco.codec import PelcoFraming
from ptu_drivers.pelco.unit import PelcoOptions, connect_pelco
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from tests.contracts.pan_tilt_unit import ContractRig, PanTiltContract


def pelco_rig(model: PelcoModel, **options: object) -> ContractRig:
    unit = SimulatedPelco(model, seed=4)
    line = VirtualLine(unit, model.baud)
    if "speeds_deg_s" in options:
        options["speeds_deg_s"] = unit.speed_table()

    def sets(name: str, value: float) -> Callable[[], None]:
        return lambda: setattr(line, name, value)

    return ContractRig(
        open=lambda settings: connect_pelco(
            line,
            settings,
            PelcoOptions(max_rate_deg_s=60.0, max_acceleration_deg_s2=120.0, **options),  # type: ignore[arg-type]
            model.framing,
            watch=False,
        ),
        now=line.now,
        wait=line.wait,
        truth=unit.head_rad,
        cut=sets("dead", True),
        mend=sets("dead", False),
        unplug=sets("gone", True),
        plug=sets("gone", False),
        trickle=lambda apart_s: setattr(line, "trickle_s", apart_s),
        at=line.at,
        lease=LeaseKind.NONE if "speeds_deg_s" in options else LeaseKind.NO_RATES,
        settings=UnitSettings(),
        time_sigma_s=0.0005,
    )


class TestPelcoD(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return pelco_rig(PelcoModel())


class TestPelcoDOnTwoWiresWithRates(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return pelco_rig(PelcoModel(echo=True), speeds_deg_s={})


class TestPelcoDThatAcknowledges(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        return pelco_rig(PelcoModel(acknowledges=True), acknowledges=True)


class TestPelcoPOfTheOtherSenses(PanTiltContract):
    @pytest.fixture
    def rig(self) -> ContractRig:
        model = PelcoModel(framing=PelcoFraming.P, address=7, baud=4800, clockwise=False, downwards=False)
        return pelco_rig(model, address=7, pan_sign=1, tilt_sign=1)
