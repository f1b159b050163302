"""Compiled kernels take named values: no argument is a packed vector that is read by literal indices.

The rule. In a function compiled by numba (decorated with ``njit``), an argument is a packed vector if it is subscripted
by two or more different integer literals, as ``a[3]`` or as the last index of a table's row, ``a[i, 3]``, and

- one of the literals is 3 or more: neither a pixel (u, v) nor a point or direction (x, y, z) has such an element; or
- the argument is a plain tuple of three or more values, for which a named tuple costs nothing.

Elements of a matrix whose indices are both literals, ``a[0, 1]``, are not counted. What the rule finds is passed as
named arguments or as a named tuple, or indexed by named constants where its order is fixed elsewhere (a filter state).
"""

import ast
import textwrap
from collections.abc import Iterator

from tests.architecture.sources import Function, functions

LEAST_PACKED_INDEX = 3
LEAST_PACKED_TUPLE = 3

# quaternions (w, x, y, z) and dual quaternions (two of them) are indexed in the literature's formulas
QUATERNIONS = {"q"}


def is_kernel(node: Function) -> bool:
    return any("njit" in ast.unparse(decorator) for decorator in node.decorator_list)


def literal_index(index: ast.expr) -> int | None:
    """Return the literal of ``a[3]`` or ``a[i, 3]``; None for other indices, and for ``a[0, 3]``."""
    if isinstance(index, ast.Tuple) and len(index.elts) == 2 and literal_index(index.elts[0]) is None:
        return literal_index(index.elts[1])
    if isinstance(index, ast.Constant) and isinstance(index.value, int):
        return index.value
    return None


def is_long_tuple(annotation: ast.expr | None) -> bool:
    match annotation:
        case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=elements)):
            return len(elements) >= LEAST_PACKED_TUPLE
    return False


def packed_arguments(node: Function) -> Iterator[str]:
    """Yield the arguments of a kernel that are packed vectors."""
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    annotations = {a.arg: a.annotation for a in given if a.arg not in QUATERNIONS}
    literals: dict[str, set[int]] = {}
    for part in ast.walk(node):
        if isinstance(part, ast.Subscript) and isinstance(part.value, ast.Name) and part.value.id in annotations:
            index = literal_index(part.slice)
            if index is not None:
                literals.setdefault(part.value.id, set()).add(index)
    for name, found in literals.items():
        if len(found) > 1 and (max(found) >= LEAST_PACKED_INDEX or is_long_tuple(annotations[name])):
            yield name


def packed_vectors() -> Iterator[str]:
    """Yield each packed argument of all kernels: module, function, argument."""
    for name, node in functions():
        if is_kernel(node):
            yield from (f"{name}({argument})" for argument in packed_arguments(node))


def test_kernels_read_no_packed_vector_by_literal_indices() -> None:
    assert not list(packed_vectors())


def test_the_rule_finds_packed_vectors_and_leaves_points_and_matrices() -> None:
    source = """
    @njit(cache=True)
    def kernel(pixel, point, matrix, table, rows, packed, q, box: tuple[int, int, int], pair: tuple[int, int]):
        a = pixel[0] + pixel[1] + point[0] + point[1] + point[2] + matrix[0, 3] + matrix[1, 4] + pair[0] + pair[1]
        b = table[a, 0] + table[a, 3] + rows[a, 0] + rows[a, 1] + packed[0] + packed[5] + q[0] + q[3]
        return a + b + box[0] + box[1]
    """
    (node,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(node, ast.FunctionDef)
    assert set(packed_arguments(node)) == {"table", "packed", "box"}
