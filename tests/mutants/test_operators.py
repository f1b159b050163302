"""Each kind of fault really changes what a function does, and text, logs and heads of definitions stay."""

import ast
import textwrap
from collections.abc import Callable
from typing import Any

import pytest
from mutants.operators import RULES
from mutants.places import Function, functions_of


def function_of(source: str, name: str = "f") -> Function:
    found = {function.name: function for function in functions_of(textwrap.dedent(source), "groundstation.sample.part")}
    return found[name]


def made(function: Function, ordinal: int, kind: str) -> Callable[..., Any]:
    """The function with one of its faults, ready to be called."""
    fault = [fault for fault in function.faults if fault.kind == kind][ordinal]
    tree = ast.Module(body=[function.with_fault(fault)], type_ignores=[])
    space: dict[str, Any] = {}
    exec(compile(tree, "sample", "exec"), space)
    return space[function.name]


# kind, which of the faults, source, arguments, what the function gives, what it gives with the fault
SAMPLES = [
    ("boundary", 0, "def f(a): return a < 3", (3,), False, True),
    ("boundary", 1, "def f(a): return 1 < a < 3", (3,), False, True),
    ("equality", 0, "def f(a): return a == 3", (3,), True, False),
    ("equality", 0, "def f(a): return a not in (3, 4)", (3,), False, True),
    ("arithmetic", 0, "def f(a): return a + 2", (5,), 7, 3),
    ("arithmetic", 0, "def f(a):\n    a *= 2\n    return a", (5,), 10, 2.5),
    ("accumulation", 0, "def f(a):\n    a += 2\n    return a", (5,), 7, 2),
    ("sign", 0, "def f(a): return -a", (5,), -5, 5),
    ("not", 0, "def f(a): return not a", (True,), False, True),
    ("boolean", 0, "def f(a, b): return a and b", (True, False), False, True),
    ("boolean", 1, "def f(a, b): return a and b", (True, False), False, False),
    ("boolean", 2, "def f(a, b): return a and b", (True, False), False, True),
    ("constant", 0, "def f(a): return a * 4", (5,), 20, 25),
    ("constant", 0, "def f(a): return a * 1.5", (2,), 3.0, 6.0),
    ("constant", 0, "def f(a): return True", (2,), True, False),
    ("condition", 0, "def f(a):\n    if a > 1:\n        return 'x'\n    return 'y'", (2,), "x", "y"),
    ("condition", 1, "def f(a):\n    if a > 1:\n        return 'x'\n    return 'y'", (0,), "y", "x"),
    ("condition", 2, "def f(a): return 'x' if a else 'y'", (True,), "x", "y"),
    ("condition", 0, "def f(a): return [x for x in a if x]", ([0, 1],), [1], [0, 1]),
    ("statement", 0, "def f(a):\n    a.append(1)\n    return a", ([],), [1], []),
    ("statement", 0, "def f(a):\n    a[0] = 1\n    return a", ([0],), [1], [0]),
    ("jump", 0, "def f(a):\n    for x in a:\n        if x:\n            break\n    return x", ([1, 2],), 1, 2),
    ("handler", 0, "def f(a):\n    try:\n        return 1\n    finally:\n        a.append(1)", ([],), 1, 1),
    ("returned", 0, "def f(a): return a > 1", (2,), True, False),
    ("returned", 0, "def f(a): return 2 * a", (2,), 4, -4),
    ("returned", 0, "def f(a): return str(a)", (2,), "2", 2),
    ("arguments", 0, "def f(a): return divmod(a, 3)", (7,), (2, 1), (0, 3)),
    ("index", 0, "def f(a): return a[1]", ("xyz",), "y", "x"),
    ("index", 1, "def f(a): return a[0:2]", ("xyz",), "xy", "xyz"),
    ("default", 0, "def f(a): return sorted(a, reverse=True)", ([1, 2],), [2, 1], [1, 2]),
    ("default", 0, "def f(a): return a.get(1, 5)", ({},), 5, None),
    ("call", 0, "def f(a): return max(a)", ([1, 2],), 2, 1),
]


@pytest.mark.parametrize(("kind", "ordinal", "source", "arguments", "right", "wrong"), SAMPLES)
def test_a_fault_changes_the_functions_result(
    kind: str, ordinal: int, source: str, arguments: tuple[Any, ...], right: object, wrong: object
) -> None:
    space: dict[str, Any] = {}
    exec(textwrap.dedent(source), space)
    copies = [list(item) if isinstance(item, list) else item for item in arguments]
    assert space["f"](*copies) == right
    assert made(function_of(source), ordinal, kind)(*arguments) == wrong


def test_raise_and_handler_and_matrix_order() -> None:
    assert made(function_of("def f(a):\n    if a < 0: raise ValueError(a)\n    return a"), 0, "refusal")(-1) == -1
    handled = function_of(
        "def f(a):\n    try:\n        return 1 / a\n    except ZeroDivisionError:\n        return 0.0"
    )
    with pytest.raises(ZeroDivisionError):
        made(handled, 0, "handler")(0)
    left_out = function_of("def f(a):\n    try:\n        return 1\n    finally:\n        a.append(1)")
    noted: list[int] = []
    made(left_out, 0, "handler")(noted)
    assert noted == []
    operands = [fault for fault in function_of("def f(a, b): return a @ b").faults if fault.kind == "operands"]
    assert [(fault.before, fault.after) for fault in operands] == [("a @ b", "b @ a")]


def test_every_kind_has_a_sample() -> None:
    assert set(RULES) == {kind for kind, *_ in SAMPLES} | {"refusal", "operands"}


def test_text_heads_logs_and_small_guards_are_unchanged() -> None:
    function = function_of(
        '''
        @decorated(3)
        def f(a: Literal[3], b=4) -> Literal[5]:
            """Docstring of 6."""
            assert a == 7
            log.info("seven", 7)
            print(8)
            plot(a, linewidth=9)
            if a:
                raise ValueError(f"{a + 10} of {11}")
            return text + f"{a + 12}" + (a / 1e-9)
        '''
    )
    shown = {(fault.kind, fault.before) for fault in function.faults}
    raised = "raise ValueError(f'{a + 10} of {11}')"
    assert shown == {
        ("statement", "plot(a, linewidth=9)"),
        ("condition", "if a:"),
        ("refusal", raised),
        ("arithmetic", "a / 1e-09"),
    }
