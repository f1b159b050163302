"""Kernels that numba compiles: which of them contain which, and compiling them afresh when one is changed."""

import functools
import gc
from collections import defaultdict
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

from mutants.places import Function

Name = tuple[str, str]


def name_of(item: Any) -> Name:
    """Module and qualified name of a function or a kernel."""
    plain = item.py_func if isinstance(item, Dispatcher) else item
    return plain.__module__, plain.__qualname__


@functools.cache
def dispatchers() -> list[Dispatcher]:
    """All kernels of this process; read once, when all modules are imported."""
    return [item for item in gc.get_objects() if isinstance(item, Dispatcher)]


def called_by(function: FunctionType) -> set[Any]:
    """Functions and kernels that a function's code names, those in modules that it names included."""
    names = _names(function.__code__)
    cells = (cell.cell_contents for cell in function.__closure__ or () if _is_filled(cell))
    values = [function.__globals__[name] for name in names if name in function.__globals__] + list(cells)
    for module in [value for value in values if isinstance(value, ModuleType)]:
        values += [vars(module)[name] for name in names if name in vars(module)]
    plain: list[Any] = [value for value in values if isinstance(value, Dispatcher | FunctionType)]
    # a partial or a table of kernels
    for value in values:
        if isinstance(value, functools.partial):
            plain.append(value.func)
        elif isinstance(value, dict | tuple | list) and len(value) < 50:
            items = value.values() if isinstance(value, dict) else value
            plain += [item for item in items if isinstance(item, Dispatcher | FunctionType)]
    return set(plain)


def _is_filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is not None
    except ValueError:
        return False


def _names(code: CodeType) -> set[str]:
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names(constant)
    return names


def contained(kernel: Dispatcher, known: dict[Name, frozenset[Name]]) -> frozenset[Name]:
    """A kernel and all that are compiled into it."""
    name = name_of(kernel)
    if name not in known:
        known[name] = frozenset({name})
        parts = [
            contained(item, known)
            for item in called_by(cast(FunctionType, kernel.py_func))
            if isinstance(item, Dispatcher)
        ]
        known[name] = known[name].union(*parts)
    return known[name]


def kernels_of(
    function: FunctionType, known: dict[Name, frozenset[Name]], *, module_functions: bool = False
) -> frozenset[Name]:
    """The kernels that a function runs by name; with `module_functions` through functions of its own module too.

    `known` caches the kernels in each function, from one call to the next.
    """
    found: set[Name] = set()
    seen: set[FunctionType] = set()
    waiting = [function]
    while waiting:
        current = waiting.pop()
        seen.add(current)
        for item in called_by(current):
            if isinstance(item, Dispatcher):
                found |= contained(item, known)
            elif module_functions and item not in seen and item.__module__ == function.__module__:
                waiting.append(item)
    return frozenset(found)


def containing(name: Name) -> set[Name]:
    """All kernels that have the named one compiled into them, itself included."""
    callers: dict[Name, set[Name]] = defaultdict(set)
    known: dict[Name, frozenset[Name]] = {}
    for kernel in dispatchers():
        for part in contained(kernel, known):
            callers[part].add(name_of(kernel))
    return callers[name] | {name}


def compile_again(function: Function) -> None:
    """Make this process compile a changed kernel and those that contain it, neither reading nor writing the cache."""
    affected = containing((function.module, function.name))
    for kernel in dispatchers():
        if name_of(kernel) in affected:
            kernel._cache = NullCache()  # type: ignore[attr-defined]
