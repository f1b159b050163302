"""Marks in functions: each writes its name into a file when it is called for the first time since the last `clear`."""

import ast
import builtins
import os

from mutants.places import functions_of

NAME = "__mutants_mark__"
_seen: set[str] = set()
_file: list[int] = []


def mark(name: str) -> None:
    """Note a function as called; also from threads and forked processes, which append to the same file."""
    if name not in _seen:
        _seen.add(name)
        if not _file:
            _file.append(os.open(os.environ["MUTANTS_HITS"], os.O_WRONLY | os.O_APPEND | os.O_CREAT))
        os.write(_file[0], f"{name}\n".encode())


def clear(file: str) -> None:
    """Begin again, with another file; processes started from now on write to it too."""
    os.environ["MUTANTS_HITS"] = file
    _seen.clear()
    for descriptor in _file:
        os.close(descriptor)
    _file.clear()


def again() -> None:
    """Let functions that have been noted be noted once more, in the same file."""
    _seen.clear()


def marked(source: str, module: str) -> ast.Module:
    """A module's tree with a mark at the start of each function, kernels excepted; line numbers stay."""
    setattr(builtins, NAME, mark)
    nodes = {function.node.lineno: function.name for function in functions_of(source, module) if not function.is_kernel}

    class Mark(ast.NodeTransformer):
        def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
            if (name := nodes.get(node.lineno)) is None:
                return node
            call = ast.Call(
                func=ast.Name(id=NAME, ctx=ast.Load()), args=[ast.Constant(value=f"{module}:{name}")], keywords=[]
            )
            first = int(ast.get_docstring(node, clean=False) is not None)
            node.body.insert(first, ast.copy_location(ast.Expr(value=call), node.body[0]))
            return ast.fix_missing_locations(node)

        visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815

    return ast.fix_missing_locations(Mark().visit(ast.parse(source)))
