"""A function has at most 60 lines, its docstring included, and at most 10 arguments."""

from tests.architecture.sources import Function, functions

MOST_LINES = 60
MOST_ARGUMENTS = 10


def lines(node: Function) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def arguments(node: Function) -> int:
    """Return the number of arguments without ``self`` and ``cls``."""
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len([a for k, a in enumerate(given) if not (k == 0 and a.arg in ("self", "cls"))])


def test_functions_have_at_most_60_lines() -> None:
    assert not {name: n for name, node in functions() if (n := lines(node)) > MOST_LINES}


def test_functions_have_at_most_10_arguments() -> None:
    assert not {name: n for name, node in functions() if (n := arguments(node)) > MOST_ARGUMENTS}
