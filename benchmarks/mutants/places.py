"""Functions of the packages and the faults that can be put into each, located by syntax tree."""

import ast
import copy
import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mutants.operators import LOGGING, PRESENTATION, RULES, called

PACKAGES = ("groundstation", "calibration", "ptu_drivers")
# what an object is called in a message
SPOKEN = frozenset({"__repr__", "__str__"})
# a definition's head is not its body: annotations, decorators and defaults stay as they are
HEAD = frozenset({"annotation", "returns", "decorator_list", "args", "type_params", "type_comment"})
_ERASED = HEAD - {"args"} | {"name", "id", "attr", "arg", "asname", "module", "ctx", "kind"}
_JITS = frozenset({"njit", "jit", "vectorize", "guvectorize"})

Step = tuple[str, int | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One change of one function.

    Attributes
    ----------
    kind : name of the rule in ``operators.RULES``
    ordinal : its place among the function's faults of this kind, in the order of the text
    before, after : source of the node and of what replaces it
    path : the node's place below the function's own node
    replacement : the node that replaces it
    """

    kind: str
    ordinal: int
    before: str
    after: str
    path: tuple[Step, ...]
    replacement: ast.AST


@dataclass(frozen=True, kw_only=True)
class Function:
    """A function of a module or a method of a class; functions within it belong to it."""

    package: str
    module: str
    name: str
    node: ast.FunctionDef | ast.AsyncFunctionDef

    @property
    def lines(self) -> int:
        """How many lines it has, head included."""
        return (self.node.end_lineno or self.node.lineno) - self.node.lineno + 1

    @property
    def is_kernel(self) -> bool:
        """Whether numba compiles it."""
        names = (ast.unparse(decorator).split("(")[0].split(".")[-1] for decorator in self.node.decorator_list)
        return not _JITS.isdisjoint(names)

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """All faults that can be put in, in the order of the text."""
        counts: Counter[str] = Counter()
        found = []
        for path, node in _nodes(self.node):
            before = ""
            within_index = any(field == "slice" for field, _ in path)
            for kind, rule in RULES.items():
                if within_index and kind == "constant":
                    continue
                for replacement in rule(node):
                    # nearly all nodes have no replacement, and one that has some has several
                    before = before or _text(node)
                    after = _text(replacement)
                    if before == after:
                        continue
                    found.append(
                        Fault(
                            kind=kind,
                            ordinal=counts[kind],
                            before=before,
                            after=after,
                            path=path,
                            replacement=replacement,
                        )
                    )
                    counts[kind] += 1
        return tuple(found)

    @cached_property
    def shape(self) -> str:
        """Hash of the body with all names erased: the same after renaming and after a move."""
        return hashlib.sha256(erased(self.node).encode()).hexdigest()[:12]

    def with_fault(self, fault: Fault) -> ast.FunctionDef | ast.AsyncFunctionDef:
        """The function's node with one fault put in; this one stays as it is."""
        changed = copy.deepcopy(self.node)
        parent: ast.AST = changed
        for field, place in fault.path[:-1]:
            parent = _child(parent, field, place)
        field, place = fault.path[-1]
        replacement = copy.deepcopy(fault.replacement)
        original = _child(parent, field, place)
        if isinstance(original, ast.expr | ast.stmt | ast.excepthandler):
            ast.copy_location(replacement, original)
        if place is None:
            setattr(parent, field, replacement)
        else:
            getattr(parent, field)[place] = replacement
        return ast.fix_missing_locations(changed)


def package_of(module: str) -> str:
    """The stratum of a module: a folder of ``groundstation``, its flat modules together, or a package of its own.

    >>> package_of("groundstation.onboard.pose.pose_solver"), package_of("groundstation.tracking.pipeline")
    ('groundstation.onboard', 'groundstation')
    """
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "groundstation" and len(parts) > 2 else parts[0]


def read_functions(root: Path) -> dict[tuple[str, str], Function]:
    """All functions below `root` that faults may be put into, by module and qualified name."""
    found = {}
    for package in PACKAGES:
        for file in sorted((root / package).rglob("*.py")):
            parts = file.relative_to(root).with_suffix("").parts
            module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            for function in functions_of(file.read_text(encoding="utf-8"), module):
                found[module, function.name] = function
    return found


def functions_of(source: str, module: str) -> list[Function]:
    """The functions of one module's source; those whose name is defined twice (a property and its setter) left out."""
    package = package_of(module)
    found = [
        Function(package=package, module=module, name=name, node=node)
        for name, node in _definitions(ast.parse(source), "")
        if name.split(".")[-1] not in SPOKEN
    ]
    names = Counter(function.name for function in found)
    return [function for function in found if names[function.name] == 1]


def erased(node: ast.AST) -> str:
    """A tree as text without names, annotations, decorators and docstrings; constants and operators stay."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return ""
    parts = [type(node).__name__]
    for field, value in ast.iter_fields(node):
        if field in _ERASED:
            continue
        if isinstance(value, list):
            parts.append("[" + ",".join(erased(item) if isinstance(item, ast.AST) else "_" for item in value) + "]")
        elif isinstance(value, ast.AST):
            parts.append(erased(value))
        else:
            parts.append(repr(value))
    return "(" + " ".join(parts) + ")"


def _definitions(parent: ast.AST, prefix: str) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Functions of modules and classes, also below a condition, but none within a function."""
    for child in ast.iter_child_nodes(parent):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield prefix + child.name, child
        elif isinstance(child, ast.ClassDef):
            yield from _definitions(child, f"{prefix}{child.name}.")
        elif isinstance(child, ast.If | ast.Try) and "TYPE_CHECKING" not in ast.unparse(getattr(child, "test", child)):
            yield from _definitions(child, prefix)


def _nodes(node: ast.AST, path: tuple[Step, ...] = ()) -> Iterator[tuple[tuple[Step, ...], ast.AST]]:
    """All nodes below a function that a fault may replace, in the order of the text."""
    for field, value in ast.iter_fields(node):
        if field in HEAD and not (field == "args" and isinstance(node, ast.Call)):
            continue
        children = enumerate(value) if isinstance(value, list) else ((None, value),)
        for place, child in children:
            if isinstance(child, ast.AST) and not _is_left_alone(child):
                below = (*path, (field, place))
                yield below, child
                if not isinstance(child, ast.Raise):
                    yield from _nodes(child, below)


def _is_left_alone(node: ast.AST) -> bool:
    """Text, log lines, assertions and the appearance of pictures."""
    if isinstance(node, ast.JoinedStr | ast.Assert | ast.expr_context | ast.operator | ast.cmpop):
        return True
    if isinstance(node, ast.keyword):
        return node.arg in PRESENTATION
    if isinstance(node, ast.Expr):
        return called(node.value) in LOGGING
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def _child(parent: ast.AST, field: str, place: int | None) -> ast.AST:
    value = getattr(parent, field)
    return value if place is None else value[place]


def _text(node: ast.AST) -> str:
    """Source of a node; of a compound statement its head alone, which is all that a rule changes."""
    if isinstance(node, ast.If | ast.While):
        return f"{type(node).__name__.lower()} {ast.unparse(node.test)}:"
    if isinstance(node, ast.comprehension):
        return " ".join([f"in {ast.unparse(node.iter)}", *(f"if {ast.unparse(test)}" for test in node.ifs)])
    if isinstance(node, ast.Try):
        return "finally: " + "; ".join(ast.unparse(statement) for statement in node.finalbody)
    if isinstance(node, ast.Assign) and not hasattr(node, "lineno"):
        # of all statements that a rule makes, its text alone depends on having a line
        node = ast.Assign(targets=node.targets, value=node.value, lineno=1)
    return ast.unparse(node)
