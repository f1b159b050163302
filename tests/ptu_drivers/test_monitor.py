"""The result of a move that `groundstation ptu jog` reports, in virtual time: arrived, missed or unknown."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import pytest

from ptu_drivers import Axis, NoReading, PanTiltUnit, UnitSettings
from ptu_drivers.errors import LineError
from ptu_drivers.flir.setup import connect
from ptu_drivers.messages import Reading
from ptu_drivers.monitor import MoveResult, format_moved, halted, move
from ptu_drivers.pelco.codec import PelcoFraming
from ptu_drivers.pelco.unit import PelcoOptions, connect_pelco
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco

FAR_RAD = 2.5


def flir(homing_s: float = 3.0) -> tuple[VirtualLine, PanTiltUnit]:
    line = VirtualLine(SimulatedUnit(FlirModel(homing_s=homing_s), LineModel(), seed=1))
    return line, connect(line, UnitSettings())


def pelco() -> tuple[VirtualLine, PanTiltUnit]:
    line = VirtualLine(SimulatedPelco(PelcoModel(), seed=1))
    options = PelcoOptions(max_rate_deg_s=60.0, max_acceleration_deg_s2=120.0)
    return line, connect_pelco(line, UnitSettings(), options, PelcoFraming.D, watch=False)


def moved(
    line: VirtualLine, unit: PanTiltUnit, after_s: float = 0.0, act: Callable[[], None] | None = None
) -> MoveResult:
    if act is not None:
        line.at(line.now() + after_s, act)
    (pan,) = move(unit, {Axis.PAN: FAR_RAD}, None, line.now, line.wait)
    return pan


def test_arrived() -> None:
    pan = moved(*flir())
    assert pan.lost_steps <= 1
    assert not pan.lost_line
    assert ": reached; moved after" in format_moved(pan)


def test_a_unit_that_stands_at_its_target_has_no_lag() -> None:
    line, unit = flir()
    (pan,) = move(unit, {Axis.PAN: 0.0}, None, line.now, line.wait)
    assert format_moved(pan) == "pan     0.0000 deg: reached; did not move"


@pytest.mark.parametrize("make", [flir, pelco])
def test_a_line_that_stays_lost_is_no_missed_target(make: Callable[[], tuple[VirtualLine, PanTiltUnit]]) -> None:
    """Without readings the position is unknown: no number of steps is reported, and the wait has an end."""
    line, unit = make()
    began = line.now()
    with pytest.raises(
        LineError, match=r"the line lost on the way: no angle for 5.* it may still move; wanted an angle"
    ):
        moved(line, unit, 1.0, lambda: setattr(line, "dead", True))
    assert line.now() - began < 10.0


def test_the_return_of_a_line_is_reported_with_the_steps() -> None:
    line, unit = flir()
    line.at(line.now() + 2.0, lambda: setattr(line, "gone", False))
    pan = moved(line, unit, 1.0, lambda: setattr(line, "gone", True))
    assert pan.lost_line
    # this unit is halted when it receives again
    assert pan.lost_steps > 100
    assert f"MISSED by {pan.lost_steps} steps; THE LINE WAS LOST on the way" in format_moved(pan)


def test_a_unit_that_homes_on_the_way() -> None:
    line, unit = flir()
    pan = moved(line, unit, 0.5, lambda: line.unit.power_cycle(line.now(), 0.5))
    assert pan.lost_line
    assert "MISSED by" in format_moved(pan)
    # as long as it is deaf, it is a line that is lost
    line, unit = flir(homing_s=30.0)
    with pytest.raises(LineError, match="the line lost on the way"):
        moved(line, unit, 0.5, lambda: line.unit.power_cycle(line.now(), 0.5))


def test_angles_that_tremble_in_their_last_digits_are_at_rest() -> None:
    """A mount that computes its angles never gives the same number twice."""
    line, unit = flir()
    read, turns = unit.read, itertools.count()

    def trembling() -> Reading | NoReading:
        got = read()
        if isinstance(got, NoReading):
            return got
        return replace(got, pan=replace(got.pan, angle_rad=got.pan.angle_rad + 1e-8 * (next(turns) % 2)))

    unit.read = trembling  # type: ignore[method-assign]
    began = line.now()
    assert moved(line, unit).lost_steps <= 1
    assert line.now() - began < 60.0


def test_an_unacknowledged_halt_is_not_reported_as_one() -> None:
    line, unit = flir()
    unit.move_to(pan_rad=FAR_RAD)
    line.wait(0.5)
    assert halted(unit) == "it was halted"
    unit.move_to(pan_rad=-FAR_RAD)
    line.dead = True
    assert halted(unit) == "no answer to the halt: it may still move"
