"""A function has at most 60 lines, its docstring included, and at most 10 arguments."""

from tests.architecture.sources import Function, functions

MOST_LINES = 60
MOST_ARGUMENTS = 10

# exceed a limit today; an entry is removed with what it names, and none is added
LONG: set[str] = {
    "groundstation.detection.chan_vese.evolve",
    "groundstation.detection.contour_evolution.evolve_contour",
    "groundstation.detection.fuselage._weigh",
    "groundstation.live.command._live",
    "groundstation.onboard.visual_inertial.corner_finder.find_corners",
    "groundstation.onboard.scenes.ground_kernel.render_ground",
}
MANY_ARGUMENTS: set[str] = {
    "groundstation.live.operation.Operation.__init__",
    "groundstation.simulation.render_kernels.surroundings",
}


def lines(node: Function) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def arguments(node: Function) -> int:
    """Return the number of arguments without ``self`` and ``cls``."""
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len([a for k, a in enumerate(given) if not (k == 0 and a.arg in ("self", "cls"))])


def test_functions_have_at_most_60_lines() -> None:
    found = {name: n for name, node in functions() if (n := lines(node)) > MOST_LINES}
    assert not {name: n for name, n in found.items() if name not in LONG}


def test_functions_have_at_most_10_arguments() -> None:
    found = {name: n for name, node in functions() if (n := arguments(node)) > MOST_ARGUMENTS}
    assert not {name: n for name, n in found.items() if name not in MANY_ARGUMENTS}
