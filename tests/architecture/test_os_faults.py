"""What the operating system refuses reaches users in words: no handler prints the error itself, with its number."""

import ast
from collections.abc import Iterator

from tests.architecture.sources import modules, statements_of


def _handlers() -> Iterator[tuple[str, ast.ExceptHandler]]:
    for module, path in modules().items():
        for node in statements_of(path):
            if isinstance(node, ast.ExceptHandler) and node.name and node.type is not None:
                kinds = {inner.id for inner in ast.walk(node.type) if isinstance(inner, ast.Name)}
                if kinds & {"OSError", "FileNotFoundError", "PermissionError", "ConnectionError"}:
                    yield module, node


def _raw_uses(handler: ast.ExceptHandler) -> Iterator[int]:
    """Yield the lines that make text of the caught error by `str` or in an f-string."""
    for node in ast.walk(handler):
        inner: ast.expr | None = None
        if isinstance(node, ast.FormattedValue):
            inner = node.value
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str" and node.args:
            inner = node.args[0]
        if isinstance(inner, ast.Name) and inner.id == handler.name:
            yield node.lineno


def test_no_handler_prints_the_error_itself() -> None:
    raw = [f"{module}:{line}" for module, handler in _handlers() for line in _raw_uses(handler)]
    assert not raw, f"use os_words: {raw}"


def test_a_raw_use_is_found() -> None:
    text = "try:\n    f()\nexcept OSError as e:\n    print(str(e), f'{e}', e.strerror, f'{e.filename}')\n"
    (handler,) = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ExceptHandler))
    assert list(_raw_uses(handler)) == [4, 4]
