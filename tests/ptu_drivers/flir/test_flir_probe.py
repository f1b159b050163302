"""What the probe and the poll of a FLIR unit do with an answer that another line has run into."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from ptu_drivers import UnitSettings
from ptu_drivers.errors import ProtocolError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import FlirReply
from ptu_drivers.flir.poll import Poller
from ptu_drivers.flir.probe import _axis
from ptu_drivers.flir.setup import connect
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import Axis, Reading
from ptu_drivers.simulated.faults import FAULTS
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

FACTS = {"PR": "92.571428", "PN": "-3000", "PX": "3000", "PL": "31", "PU": "2000", "PS": "1000", "PA": "2000"}


def line_saying(answers: dict[str, list[str]]) -> SimpleNamespace:
    """A line whose questions are answered from a list each; the last answer stays."""

    def query(command: str) -> SimpleNamespace:
        left = answers[command]
        text = left.pop(0) if len(left) > 1 else left[0]
        return SimpleNamespace(answer=FlirReply(echo=command, ok=True, text=text, events=(), mark_at=3, delimiter_at=2))

    return SimpleNamespace(query=query)


def test_a_number_corrupted_by_another_line_is_queried_again() -> None:
    facts = _axis(
        line_saying({name: [text] for name, text in FACTS.items()} | {"PN": ["-30 -3000", "-30 -3000", "-3000"]}), "P"
    )
    assert (facts.low, facts.high, facts.max_rate) == (-3000, 3000, 2000)


def test_three_such_replies_are_not_a_number() -> None:
    with pytest.raises(ProtocolError):
        _axis(line_saying({name: [text] for name, text in FACTS.items()} | {"PN": ["-30 -3000"]}), "P")


@dataclass
class Gate:
    """A gate that confirms nothing, and notes whether its past was dropped."""

    forgotten: bool = False

    def confirms(self, first: object, second: object) -> bool:
        return False

    def forget(self) -> None:
        self.forgotten = True


def test_two_readings_that_contradict_each_other_leave_no_past() -> None:
    poller = Poller.__new__(Poller)
    gates = {axis: Gate() for axis in Axis}
    poller._gates, poller._clock = gates, None
    raw = SimpleNamespace(counts=dict.fromkeys(Axis, 7), point=lambda axis: None)
    with pytest.raises(ExchangeFailed) as failure:
        poller._compare(raw, raw)
    assert failure.value.reason is FailureReason.UNCONFIRMED
    assert all(gate.forgotten for gate in gates.values())


def test_slaved_moves_wait_for_one_another() -> None:
    unit = SimulatedUnit(FlirModel(combined=False, device_clock=False), LineModel(), seed=3)
    flir = unit.flir
    flir.slaved = True
    for letter, word, goal in (("P", "Pan", 100), ("T", "Tilt", -50)):
        flir._go(flir.axes[letter], word, goal, 0.0)
    assert flir.waiting == {"P": 100, "T": -50}
    assert [flir.axes[letter].target for letter in "PT"] == [0, 0]
    flir._release(1.0)
    assert [round(flir.axes[letter].target - flir.axes[letter].origin) for letter in "PT"] == [100, -50]


def test_the_verbose_fault_makes_the_unit_verbose() -> None:
    line = VirtualLine(SimulatedUnit(FlirModel(combined=False, device_clock=False), LineModel(), seed=3))
    with connect(line, UnitSettings()):
        assert not line.unit.flir.verbose
        assert FAULTS["verbose"](line, None) == 0.0
        assert line.unit.flir.verbose


@pytest.mark.parametrize("at_s", [0.1, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3])
def test_a_unit_is_opened_though_it_is_silent_for_a_while(at_s: float) -> None:
    """Expected: at whichever step of the set-up two and a half seconds of silence begin, it goes on after them."""
    line = VirtualLine(SimulatedUnit(FlirModel(combined=False, device_clock=False), LineModel(), seed=3))
    began = line.now()
    line.at(began + at_s, lambda: setattr(line, "dead", True))
    line.at(began + at_s + 2.5, lambda: setattr(line, "dead", False))
    with connect(line, UnitSettings()) as unit:
        assert any(isinstance(unit.read(), Reading) for _ in range(20))
    assert line.now() - began > at_s + 2.5
