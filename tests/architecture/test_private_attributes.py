"""No module reads a private attribute that another module's class defines."""

import ast
from collections.abc import Sequence

import pytest

from tests.architecture.sources import ROOT, WITH_BENCHMARKS, modules, nodes_of

# of the standard library and of installed packages, which offer no public name for it
OF_LIBRARIES = {
    "_SubParsersAction": "argparse",
    "_actions": "argparse",
    "_basetemp": "pytest",
    "_cache": "numba",
    "_current_frames": "sys",
    "_exit": "os",
    "_fixtureinfo": "pytest",
    "_ifaces": "harvesters",
    "_negative_number_matcher": "argparse",
    "_replace": "typing.NamedTuple",
    "_tmp_path_factory": "pytest",
}


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__")


def definitions(nodes: Sequence[ast.AST]) -> set[str]:
    """Return the private names that a module defines: functions, classes, variables, attributes of self and slots."""
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name):
            if isinstance(node.ctx, ast.Store):
                found.add(node.id)
        elif isinstance(node, ast.Attribute):
            if (
                isinstance(node.ctx, ast.Store)
                and isinstance(node.value, ast.Name)
                and node.value.id in ("self", "cls")
            ):
                found.add(node.attr)
        elif isinstance(node, ast.Assign):
            match node:
                case ast.Assign(targets=[ast.Name(id="__slots__")], value=slots):
                    parts = (c.value for c in ast.walk(slots) if isinstance(c, ast.Constant))
                    found |= {part for part in parts if isinstance(part, str)}
    return {name for name in found if is_private(name)}


def bases(nodes: Sequence[ast.AST]) -> set[str]:
    """Return the names of the classes that the module's classes derive from."""
    return {ast.unparse(base) for node in nodes if isinstance(node, ast.ClassDef) for base in node.bases}


def foreign_private_names(nodes: Sequence[ast.AST]) -> list[str]:
    """Return the private names that a module uses and does not define; a class's own base is not foreign to it."""
    imported = [
        f"{node.lineno}: {node.module}.{a.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for a in node.names
        if is_private(a.name)
    ]
    used = [n for n in nodes if isinstance(n, ast.Attribute) and is_private(n.attr) and n.attr not in OF_LIBRARIES]
    if not used:
        return imported
    # passes of their own, which modules without a private attribute do not need
    own, derived_from = definitions(nodes), bases(nodes) | {"self", "cls", "super()"}
    foreign = [n for n in used if n.attr not in own and ast.unparse(n.value) not in derived_from]
    return imported + [f"{n.lineno}: {ast.unparse(n)}" for n in foreign]


@pytest.mark.parametrize("package", WITH_BENCHMARKS)
def test_no_module_reads_another_ones_private_attributes(package: str) -> None:
    found = []
    for path in modules((package,)).values():
        found += [f"{path.relative_to(ROOT)}:{line}" for line in foreign_private_names(nodes_of(path))]
    assert not found, "\n".join(found)


def test_the_checker_finds_foreign_private_attributes() -> None:
    text = """
from other import Base, _hidden
class Child(Base):
    __slots__ = ("_slot",)
    def __init__(self, peer):
        self._own = peer._slot, peer._own, peer._foreign, peer.__class__, self._of_base
        Base._step(self)
        super()._step()
"""
    assert foreign_private_names(tuple(ast.walk(ast.parse(text)))) == ["2: other._hidden", "6: peer._foreign"]
