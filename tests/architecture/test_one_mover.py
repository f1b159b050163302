"""Only one place moves hardware in operation; two tools for users do so before the flight, with a warning."""

import ast
from pathlib import Path

from ptu_drivers.interface import PanTiltUnit
from tests.architecture.sources import imports_of, modules, nodes_of, text_of

# what makes a unit turn, or stop turning
MOVES = {"move_to", "move_at", "halt", "home"}
OPERATION = "groundstation.live.head_worker"
# `check --move`, and `ptu jog` and `ptu probe --move`
TOOLS = {"groundstation.live.check", "ptu_drivers.monitor"}
# passes commands on to a unit, or refuses them
GUARD = "groundstation.live.keep_out_unit"
# its heads are numbers
VIRTUAL = "groundstation.simulation.closed_loop"


def calls(path: Path, names: set[str]) -> set[str]:
    """Return which of these names are called as methods or functions."""
    found = set()
    text = text_of(path)
    if not any(name in text for name in names):
        return found
    for node in nodes_of(path):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            found |= {name} & names
    return found


def test_the_list_of_moves_is_the_interfaces() -> None:
    """Expected: a new method that moves has to be put here, or named as one that does not."""
    still = {"describe", "read", "health", "close"}
    public = {name for name in vars(PanTiltUnit) if not name.startswith("_")}
    assert public == MOVES | still


def test_only_one_place_moves_hardware_in_operation() -> None:
    movers = {}
    for name, path in modules().items():
        if not name.startswith("ptu_drivers.") or name in TOOLS:
            found = calls(path, MOVES)
            if found and name != VIRTUAL:
                movers[name] = found
    assert not [i for i in imports_of(modules()[VIRTUAL]) if i.startswith("ptu_drivers")]
    assert set(movers) == {OPERATION, GUARD} | TOOLS
    assert {"move_to", "move_at", "halt"} <= movers[OPERATION]


def test_nobody_else_in_operation_holds_a_unit() -> None:
    """Expected: units are opened by one function, which the PTUs' process and the check alone call."""
    makers = {"open_head", "open_ptu", "HeadWorker"}
    users = {}
    for name, path in modules().items():
        if name.startswith("groundstation.") and not name.startswith("groundstation.cli."):
            found = calls(path, makers)
            if found:
                users[name] = found
    assert users == {
        "groundstation.live.head_device": {"open_ptu"},
        "groundstation.live.head_process": {"open_head", "HeadWorker"},
        "groundstation.live.check": {"open_head"},
        "groundstation.live.keep_out_zones": {"open_head"},
    }


def test_every_opening_of_a_ptu_applies_its_keep_out_zones() -> None:
    """Expected: units are wrapped where a station's are opened; `ptu` opens others only by a URL, and warns of it."""
    openers = {
        name: calls(path, {"open_ptu", "KeepOutUnit"})
        for name, path in modules().items()
        if not name.startswith("ptu_drivers") and "open_ptu" in text_of(path)
    }
    assert {name: found for name, found in openers.items() if "open_ptu" in found} == {
        "groundstation.live.head_device": {"open_ptu", "KeepOutUnit"},
        "groundstation.cli.ptu_open": {"open_ptu"},
    }
