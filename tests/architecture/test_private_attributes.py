"""No module reads a private attribute that another module's class defines."""

import ast

import pytest

from tests.architecture.sources import ROOT, WITH_BENCHMARKS, modules, tree_of

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


def definitions(tree: ast.Module) -> set[str]:
    """Return the private names that a module defines: functions, classes, variables, attributes of self and slots."""
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.Name(id=name, ctx=ast.Store()):
                found.add(name)
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name, ctx=ast.Store()):
                found.add(name)
            case ast.Assign(targets=[ast.Name(id="__slots__")], value=slots):
                found |= {c.value for c in ast.walk(slots) if isinstance(c, ast.Constant) and isinstance(c.value, str)}
    return {name for name in found if is_private(name)}


def bases(tree: ast.Module) -> set[str]:
    """Return the names of the classes that the module's classes derive from."""
    return {ast.unparse(base) for node in ast.walk(tree) if isinstance(node, ast.ClassDef) for base in node.bases}


def foreign_private_names(tree: ast.Module) -> list[str]:
    """Return the private names that a module uses and does not define; a class's own base is not foreign to it."""
    own, derived_from = definitions(tree), bases(tree) | {"self", "cls", "super()"}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_private(node.attr) and node.attr not in own | OF_LIBRARIES.keys():
            if ast.unparse(node.value) not in derived_from:
                found.append(f"{node.lineno}: {ast.unparse(node)}")
        elif isinstance(node, ast.ImportFrom):
            found += [f"{node.lineno}: {node.module}.{a.name}" for a in node.names if is_private(a.name)]
    return found


@pytest.mark.parametrize("package", WITH_BENCHMARKS)
def test_no_module_reads_another_ones_private_attributes(package: str) -> None:
    found = []
    for path in modules((package,)).values():
        found += [f"{path.relative_to(ROOT)}:{line}" for line in foreign_private_names(tree_of(path))]
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
    assert foreign_private_names(ast.parse(text)) == ["2: other._hidden", "6: peer._foreign"]
