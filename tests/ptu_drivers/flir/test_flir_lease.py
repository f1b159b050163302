"""Targets a lease ahead: how far, when they are renewed or drawn back, and what is done where nothing was renewed."""

import math
from dataclasses import replace

import pytest

from ptu_drivers.flir.description import describe_unit
from ptu_drivers.flir.probe import AxisFacts, UnitFacts
from ptu_drivers.flir.rate_chain import RateChain, lease_of, lease_s
from ptu_drivers.flir.unit_conversion import Converter
from ptu_drivers.lease import MOVES_ONLY, NO_LEASE, LeaseKind
from ptu_drivers.messages import AngleSample, AngleSource, Axis, Reading
from ptu_drivers.settings import AxisSettings, UnitSettings
from ptu_drivers.simulated.flir_line import SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

AXIS = AxisFacts(arcsec=22.5, low=-20000, high=20000, min_rate=1, max_rate=8000, rate=2000, acceleration=8000.0)
FACTS = UnitFacts(model="test", firmware="", serial="", pan=AXIS, tilt=AXIS, pace_s=0.0, combined=False, clock_hz=0.0)


class Rig:
    """A chain with a clock of its own; what it commands is kept."""

    def __init__(self, facts: UnitFacts = FACTS, settings: UnitSettings | None = None) -> None:
        self.t_s = 10.0
        self.reported: list[str] = []
        settings = settings or UnitSettings()
        about = describe_unit(facts, VirtualLine(SimulatedUnit()), settings, 0.5)
        self.converter = Converter(facts=facts, description=about, settings=settings)
        self.chain = RateChain(self.converter, self.reported.append, lambda: self.t_s)

    def see(self, pan: float, tilt: float = 0.0) -> None:
        angles = {Axis.PAN: pan * AXIS.quantum_rad, Axis.TILT: tilt * AXIS.quantum_rad}
        samples = {
            axis: AngleSample(
                axis=axis, t_s=self.t_s, sigma_t_s=0.0, angle_rad=angle, sigma_rad=0.0, source=AngleSource.ROUND_TRIP
            )
            for axis, angle in angles.items()
        }
        self.chain.observe(
            Reading(pan=samples[Axis.PAN], tilt=samples[Axis.TILT], sent_s=self.t_s, answered_s=self.t_s)
        )

    def turn(self, pan: int, tilt: int = 0) -> list[str]:
        """Return what a rate makes it command."""
        self.reported.clear()
        self.chain.turn({Axis.PAN: pan, Axis.TILT: tilt})
        return list(self.reported)


@pytest.mark.parametrize("way", [1, -1])
def test_the_first_target_has_the_ramp_the_lease_and_the_braking(way: int) -> None:
    """From rest to 1000 counts/s in 0.125 s; 0.5 s after the command and 62.5 counts of braking: 500, and a step."""
    rig = Rig()
    rig.see(0.0)
    assert rig.turn(1000 * way) == ["HT", "PS1000", f"PP{501 * way}"]
    # the same again at once needs nothing
    assert rig.turn(1000 * way) == []


def test_a_target_is_renewed_before_its_lease_is_gone_and_not_with_every_command() -> None:
    rig = Rig()
    rig.see(0.0)
    rig.turn(1000)
    rig.t_s += 0.125
    rig.see(62.5)
    assert rig.turn(1000) == []
    rig.t_s += 0.2
    rig.see(262.5)
    # 0.5 s further, the braking and a step; 0.2 s and the braking were left
    assert rig.turn(1000) == ["PP826"]


def test_a_slower_rate_draws_the_target_back_and_a_reversal_turns_it() -> None:
    rig = Rig()
    rig.see(0.0)
    rig.turn(2000)
    rig.t_s += 0.25
    rig.see(250.0)
    # 2000 to 1000 in 0.125 s: 187.5 counts, then 0.375 s at 1000, and 62.5 of braking
    assert rig.turn(1000) == ["PS1000", "PP876"]
    # 2000 to 100 in 0.2375 s: 249.4 counts, then 0.2625 s at 100, and 0.6 of braking
    assert rig.turn(100) == ["PS100", "PP528"]
    rig.t_s += 0.25
    rig.see(502.0)
    reported = rig.turn(-1000)
    assert reported[0] == "PS1000"
    assert -100 < int(reported[1].removeprefix("PP")) < 200
    assert rig.turn(-1000) == []


def test_an_axis_that_was_not_renewed_stops_at_its_target() -> None:
    """After five silent seconds the next target is a lease beyond the old one, not five seconds' way."""
    rig = Rig()
    rig.see(0.0)
    rig.turn(1000)
    rig.t_s += 5.0
    assert rig.turn(1000) == ["PP1002"]


def test_no_target_lies_beyond_a_limit() -> None:
    soft = UnitSettings(pan=AxisSettings(low_rad=-100.4 * AXIS.quantum_rad, high_rad=1000.4 * AXIS.quantum_rad))
    rig = Rig(settings=soft)
    rig.see(950.0)
    assert rig.turn(1000) == ["HT", "PS1000", "PP1000"]
    assert rig.turn(-8000) == ["PS8000", "PP229"]
    rig.t_s += 0.1
    rig.see(0.0)
    assert rig.turn(-8000) == ["PP-100"]


def test_a_faster_rate_gets_its_target_at_once() -> None:
    """Else it would stand at the old one: near ahead for a slow rate, at the end of a lease's share for a fast one."""
    rig = Rig()
    rig.see(0.0)
    assert rig.turn(100) == ["HT", "PS100", "PP51"]
    # 0.3 s from 0 at 8000 counts/s², and as much to brake
    assert rig.turn(8000) == ["PS8000", "PP721"]
    assert rig.turn(8000) == []


def test_a_creeping_axis_has_its_target_ahead_of_it() -> None:
    """1 count/s: half a step in a lease, and readings in whole steps; the target never lies behind, nor far ahead."""
    rig = Rig()
    rig.see(0.0)
    targets = []
    for k in range(300):
        true = k * 0.05
        rig.see(round(true))
        for command in rig.turn(1, 1):
            if command.startswith("PP"):
                targets.append(int(command.removeprefix("PP")) - true)
        rig.t_s += 0.05
    assert len(targets) >= 5
    assert min(targets) > 0.0
    assert max(targets) < 3.5


def test_after_a_halt_the_angles_must_be_new() -> None:
    rig = Rig()
    assert rig.chain.is_lost()
    rig.see(0.0)
    assert not rig.chain.is_lost()
    rig.t_s += 0.31
    assert rig.chain.is_lost()
    rig.see(0.0)
    rig.turn(1000)
    rig.chain.stand()
    assert rig.chain.is_lost()
    # nothing to renew, and nothing to halt
    rig.reported.clear()
    rig.chain.renew()
    assert rig.turn(0) == []


def test_a_speed_whose_command_failed_is_sent_again() -> None:
    rig = Rig()
    rig.see(0.0)

    def refuse(command: str) -> None:
        raise ZeroDivisionError(command)

    chain = RateChain(rig.converter, refuse, lambda: rig.t_s)
    with pytest.raises(ZeroDivisionError):
        chain.set_speed(Axis.PAN, 500)
    chain._command = rig.reported.append
    chain.set_speed(Axis.PAN, 2000)
    assert rig.reported == ["PS2000"]


def test_duration_of_a_lease_and_its_description() -> None:
    """Half a second where braking leaves time for it, less for fast rates, at rest within 1 s; D-series take longer."""
    assert [lease_s(braking, 0.0) for braking in (0.0, 0.4, 0.5, 0.6, 2.0)] == pytest.approx([0.5, 0.5, 0.4, 0.3, 0.3])
    assert lease_s(0.1, 0.1) == pytest.approx(1.0)
    reported = lease_of(FACTS)
    assert reported.kind is LeaseKind.SHORT_MOVES
    assert (reported.renewed_s, reported.stop_s) == (0.5, pytest.approx(0.3 + 1.0 + 0.1))
    slow = replace(AXIS, max_rate=3200)
    assert lease_of(replace(FACTS, pan=slow, tilt=slow)).stop_s == pytest.approx(1.0)
    assert str(reported) == "motion by rate ends by short moves, at rest within 1.40 s of the last renewal"
    assert str(NO_LEASE) == "nothing in the unit ends motion by rate: it turns to its own limit"
    assert str(MOVES_ONLY) == "no motion by rate; a move to a position ends there"
    assert NO_LEASE.stop_s == MOVES_ONLY.stop_s == math.inf
