"""A fault put into the running program: the function's code is exchanged, in all places that hold the function."""

import ast
import functools
import gc
import os
from collections import defaultdict
from pathlib import Path
from types import CodeType, FunctionType

from mutants.kernels import compile_again
from mutants.places import PACKAGES, Fault, Function

INJECT = Path(__file__).parent / "inject"


def file_of(root: Path, module: str) -> Path:
    """The source of a module."""
    path = root.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def changed_module(root: Path, function: Function, fault: Fault) -> ast.Module:
    """The module's tree with the fault put in."""
    tree = ast.parse(file_of(root, function.module).read_text(encoding="utf-8"))
    changed = function.with_fault(fault)

    class Exchange(ast.NodeTransformer):
        def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
            same = (node.lineno, node.name) == (function.node.lineno, function.node.name)
            return changed if same else self.generic_visit(node)

        visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815

    return Exchange().visit(tree)


def changed_code(root: Path, function: Function, fault: Fault) -> CodeType | None:
    """The function's code with the fault in it; None when its instructions or its closure forbid the exchange.

    Instructions that stay the same are no fault; another set of variables of the class or function around it (the last
    ``super()`` of a method gone) cannot be exchanged in an object that exists.
    """
    file = file_of(root, function.module)
    original = _code_of(ast.parse(file.read_text(encoding="utf-8")), str(file), function)
    try:
        changed = _code_of(changed_module(root, function, fault), str(file), function)
    except (SyntaxError, ValueError):
        return None
    if original is None or changed is None or original.co_freevars != changed.co_freevars or _same(original, changed):
        return None
    return changed


def _same(one: CodeType, other: CodeType) -> bool:
    """Whether two codes have the same instructions, whatever their line numbers."""
    if (one.co_code, one.co_names, one.co_varnames) != (other.co_code, other.co_names, other.co_varnames):
        return False
    return len(one.co_consts) == len(other.co_consts) and all(
        _same(first, second)
        if isinstance(first, CodeType) and isinstance(second, CodeType)
        else repr(first) == repr(second)
        for first, second in zip(one.co_consts, other.co_consts, strict=True)
    )


def _code_of(tree: ast.Module, file: str, function: Function) -> CodeType | None:
    waiting = [compile(tree, file, "exec")]
    while waiting:
        code = waiting.pop()
        if code.co_qualname == function.name:
            return code
        waiting += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return None


@functools.cache
def function_objects() -> dict[tuple[str, str], list[FunctionType]]:
    """All function objects of the packages, those that decorators wrap included, by module and qualified name.

    Read once, in the process from which the others are forked, when all modules are imported.
    """
    found: dict[tuple[str, str], list[FunctionType]] = defaultdict(list)
    # what the tests' collection has frozen is not listed
    gc.unfreeze()
    for item in gc.get_objects():
        if isinstance(item, FunctionType) and (item.__module__ or "").split(".")[0] in PACKAGES:
            found[item.__module__, item.__code__.co_qualname].append(item)
    return found


def put_in(root: Path, function: Function, fault: Fault, scratch: Path) -> None:
    """Put a fault into this process and those it starts from now on."""
    code = changed_code(root, function, fault)
    objects = function_objects().get((function.module, function.name))
    if code is None or not objects:
        raise LookupError(f"no object of {function.module}.{function.name} whose code can be exchanged")
    for item in objects:
        item.__code__ = code
    if function.is_kernel:
        compile_again(function)
    else:
        os.environ.update(environment(root, function, fault, scratch))


def environment(root: Path, function: Function, fault: Fault, scratch: Path) -> dict[str, str]:
    """Environment in which a new process imports the module with the fault."""
    source = scratch / "mutated.py"
    source.write_text(ast.unparse(changed_module(root, function, fault)), encoding="utf-8")
    before = os.environ.get("PYTHONPATH")
    return {
        "PYTHONPATH": str(INJECT) if not before else f"{INJECT}{os.pathsep}{before}",
        "MUTANTS_ROOT": str(root),
        "MUTANTS_MODULE": function.module,
        "MUTANTS_SOURCE": str(source),
    }
