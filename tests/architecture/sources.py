"""Source files of the project and their syntax trees, each parsed once for all tests of the architecture."""

import ast
import gc
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("groundstation", "calibration", "ptu_drivers", "training")
WITH_BENCHMARKS = (*PACKAGES, "benchmarks")

# what statements are in: no expression has one in it, and most nodes are within one
SCOPES = (ast.stmt, ast.ExceptHandler, ast.match_case)

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def modules(packages: Sequence[str] = PACKAGES) -> dict[str, Path]:
    """Return the path of each module of some packages by its dotted name."""
    found = {}
    for package in packages:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def tree_of(path: Path) -> ast.Module:
    tree = ast.parse(text_of(path))
    # millions of nodes that all stay: no collection of garbage is to walk through them
    gc.freeze()
    return tree


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Return all nodes of a file's syntax tree."""
    return tuple(ast.walk(tree_of(path)))


@cache
def statements_of(path: Path) -> tuple[ast.stmt | ast.ExceptHandler, ...]:
    """Return all statements of a file and its handlers: a seventh of its nodes, as no expression has one in it."""
    found: list[ast.stmt | ast.ExceptHandler] = []
    scopes: list[ast.AST] = [tree_of(path)]
    while scopes:
        inner = [n for n in ast.iter_child_nodes(scopes.pop()) if isinstance(n, SCOPES)]
        found += [node for node in inner if not isinstance(node, ast.match_case)]
        scopes += inner
    return tuple(found)


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Return the dotted names that a file imports, modules and what it takes from them."""
    names: set[str] = set()
    for node in statements_of(path):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return frozenset(names)


@cache
def functions(packages: Sequence[str] = WITH_BENCHMARKS) -> tuple[tuple[str, Function], ...]:
    """Return each function of some packages with its name: module, class if any, function."""
    return tuple(
        (f"{module}.{name}", node)
        for module, path in modules(packages).items()
        for name, node in _functions_in(tree_of(path))
    )


def _functions_in(scope: ast.AST, prefix: str = "") -> Iterator[tuple[str, Function]]:
    for node in ast.iter_child_nodes(scope):
        if isinstance(node, Function):
            yield f"{prefix}{node.name}", node
            yield from _functions_in(node, f"{prefix}{node.name}.")
        elif isinstance(node, ast.ClassDef):
            yield from _functions_in(node, f"{prefix}{node.name}.")
        elif isinstance(node, SCOPES):
            yield from _functions_in(node, prefix)
