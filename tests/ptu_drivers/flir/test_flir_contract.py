"""The contract of a pan-tilt unit, by the FLIR driver on simulated units: virtual time, all kinds of query and line."""

from collections.abc import Callable

import pytest

from ptu_drivers import Axis, LeaseKind, PanTiltUnit, UnitSettings
from ptu_drivers.flir.setup import connect
from ptu_drivers.simulated.flir import D_SERIES, FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from tests.contracts.pan_tilt_unit import ContractRig, PanTiltContract

LETTER = {Axis.PAN: "P", Axis.TILT: "T"}
PLAIN = FlirModel(combined=False, device_clock=False)


def make_rig(
    model: FlirModel,
    line: LineModel,
    baud: int = 9600,
    raise_to: int = 0,
    batch_s: float = 0.0,
    rest_s: float = 1.0,
) -> ContractRig:
    unit = SimulatedUnit(model, line, seed=7)
    virtual = VirtualLine(unit, baud, batch_s=batch_s)

    def open_it(settings: UnitSettings) -> PanTiltUnit:
        return connect(virtual, settings)

    def truth(axis: Axis, t_s: float) -> float:
        return unit.flir.axes[LETTER[axis]].head(t_s) * model.arcsec * 4.84813681109536e-06

    def sets(name: str, value: float) -> Callable[[], None]:
        return lambda: setattr(virtual, name, value)

    return ContractRig(
        open=open_it,
        now=virtual.now,
        wait=virtual.settle,
        truth=truth,
        cut=sets("dead", True),
        mend=sets("dead", False),
        unplug=sets("gone", True),
        plug=sets("gone", False),
        trickle=lambda apart_s: setattr(virtual, "trickle_s", apart_s),
        at=virtual.at,
        lease=LeaseKind.SHORT_MOVES,
        rest_s=rest_s,
        settings=UnitSettings(baud=raise_to),
        time_sigma_s=0.0,
    )


RIGS = {
    "pair": lambda: make_rig(PLAIN, LineModel()),
    "combined": lambda: make_rig(FlirModel(device_clock=False), LineModel()),
    "device clock": lambda: make_rig(FlirModel(), LineModel()),
    "raised baud": lambda: make_rig(FlirModel(device_clock=False), LineModel(), raise_to=115200),
    "network": lambda: make_rig(FlirModel(), LineModel(baud=0, banner="* PAN-TILT banner " * 6, banner_s=1.0), baud=0),
    "echo that interrupts": lambda: make_rig(PLAIN, LineModel(echo_interrupts=True)),
    "USB adapter": lambda: make_rig(PLAIN, LineModel(), batch_s=0.016),
    "D series": lambda: make_rig(D_SERIES, LineModel(commands_per_s=10), rest_s=1.5),
}


class TestFlirOnSimulatedUnits(PanTiltContract):
    @pytest.fixture(params=list(RIGS))
    def rig(self, request: pytest.FixtureRequest) -> ContractRig:
        return RIGS[request.param]()
