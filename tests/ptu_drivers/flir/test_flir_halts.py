"""Halts of FLIR units that are owed, or sent where no answer comes."""

from contextlib import suppress

import pytest

from ptu_drivers import NoAnswerError, PtuError, Reading, UnitSettings, UnitState
from ptu_drivers.flir.setup import connect
from ptu_drivers.polled_unit import PolledUnit
from ptu_drivers.simulated.flir import D_SERIES, FlirModel, LineEffect
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

PAIR = FlirModel(combined=False, device_clock=False)


def opened(model: FlirModel = PAIR, commands_per_s: float = 0.0) -> tuple[PolledUnit, VirtualLine, SimulatedUnit]:
    peer = SimulatedUnit(model, LineModel(commands_per_s=commands_per_s), seed=3)
    line = VirtualLine(peer)
    line.record = True
    return connect(line, UnitSettings()), line, peer


def moves(peer: SimulatedUnit, line: VirtualLine) -> bool:
    return peer.flir.axes["P"].speed(line.now()) != 0.0


def closed_on_a_dead_line(mended_s: float | None = None) -> tuple[float, bool]:
    """Close a moving unit that accepts ten commands a second; return when the last halt began, s, and if it moves."""
    unit, line, peer = opened(D_SERIES, commands_per_s=10)
    unit.move_to(pan_rad=unit.describe().pan.high_rad, rate_rad_s=0.1)
    line.dead = True
    if mended_s is not None:
        line.at(mended_s, lambda: setattr(line, "dead", False))
    unit.close()
    line.settle(3.0)
    assert unit.health().halt_owed
    return next(t for t, way, data in reversed(line.traffic) if way == ">" and data == b"Z0 "), moves(peer, line)


def test_the_last_halt_of_a_one_way_line_reaches_a_slow_unit() -> None:
    """The line is back just before the last halt, which nothing follows; a D-series unit drops what comes too fast."""
    began_s, moved = closed_on_a_dead_line()
    assert moved
    again_s, moved = closed_on_a_dead_line(began_s - 0.001)
    assert (again_s, moved) == (began_s, False)


def test_a_halt_that_is_owed_is_sent_though_the_unit_was_only_made_verbose() -> None:
    """A command without an answer, and another program that changes the texts: set up again, and halted."""
    unit, line, peer = opened()
    unit.move_to(pan_rad=1.5, rate_rad_s=0.1)
    peer.late_s.append(0.3)
    with pytest.raises(NoAnswerError):
        unit.move_to(pan_rad=1.0)
    assert unit.health().halt_owed
    peer.flir.verbose = True
    while not isinstance(unit.read(), Reading):
        assert line.now() < 1010.0
    line.settle(1.0)
    assert unit.health().restarts == 0
    assert not unit.health().halt_owed
    assert not moves(peer, line)


def test_a_halt_that_is_refused_ends_renewals_and_is_tried_again() -> None:
    unit, line, peer = opened()
    carry_out = peer.flir.execute
    refusing = True

    def execute(command: str, t_s: float) -> LineEffect:
        return carry_out("NONSENSE" if refusing and command.upper() == "H" else command, t_s)

    peer.flir.execute = execute  # type: ignore[method-assign]
    unit.move_at(pan_rad_s=0.1, tilt_rad_s=0.0)
    unit.read()
    with suppress(PtuError):
        unit.halt()
    assert unit.health().halt_owed
    end = line.now() + 1.5
    while line.now() < end:
        unit.read()
    # its lease has run out
    assert not moves(peer, line)
    refusing = False
    assert isinstance(unit.read(), Reading)
    assert not unit.health().halt_owed
    assert unit.health().state is UnitState.READY


def test_a_line_that_breaks_at_the_halt_is_opened_and_halted_in_the_same_call() -> None:
    unit, line, peer = opened()
    unit.move_at(pan_rad_s=0.1, tilt_rad_s=0.0)
    # as when a server ends the connection
    line.close()
    unit.halt()
    line.settle(1.0)
    assert not unit.health().halt_owed
    assert line.reopened == 1
    assert not moves(peer, line)
