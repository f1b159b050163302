"""The subset of YAML in lens files: nested keys, numbers, words, lists.

OpenCV's own reader refuses Kalibr's files (lists at their key's indent), and YAML libraries refuse OpenCV's header and
matrices and read ``1e-05`` as a word. Text outside this subset is an error or, where it is not read, a string.
"""

import re
from dataclasses import dataclass
from typing import Any

from calibration.errors import IntrinsicsError
from groundstation.files.toml_table import quoted

_DEEPEST = 20
_KEY = re.compile(r"""^(?P<key>"[^"]*"|'[^']*'|[^\s:#\[\]{},"'&*!|>%@`-][^:#]*+)\s*+:(?:\s++(?P<rest>.*))?$""")
_NUMBER = re.compile(r"^[+-]?(\d++(?:\.\d*+)?|\.\d++)([eE][+-]?\d+)?$")


@dataclass(frozen=True, slots=True, kw_only=True)
class _YamlLine:
    """One line with content, its comment removed and a list in brackets joined to it."""

    number: int
    indent: int
    text: str


def parse_yaml(text: str, where: str) -> dict[str, Any]:
    """Return the keys of one YAML document; numbers are floats, everything else strings, lists and dictionaries.

    Raises
    ------
    IntrinsicsError : it is not in this subset of YAML, with ``where`` and the line.
    """
    lines = _lines(text, where)
    if not lines:
        raise IntrinsicsError(where, got="an empty file", wanted="a lens file")
    value, rest = _block(lines, 0, where, 0)
    if rest < len(lines):
        raise _fault(where, lines[rest])
    if not isinstance(value, dict):
        raise IntrinsicsError(where, got="a list", wanted="a lens file with keys")
    return value


def _fault(where: str, line: _YamlLine) -> IntrinsicsError:
    return IntrinsicsError(f"{where}, line {line.number}", got=quoted(line.text), wanted="'key: value' in YAML")


def _lines(text: str, where: str) -> list[_YamlLine]:
    lines: list[_YamlLine] = []
    # of a list in brackets that is still open: its lines so far, and how many brackets are
    open_list: list[str] = []
    unclosed = 0
    for number, raw in enumerate(text.split("\n"), start=1):
        bare = _without_comment(raw).rstrip()
        if not bare.strip() or bare.startswith(("%", "---", "...")):
            continue
        content = bare.lstrip(" ")
        if not open_list:
            lines.append(_YamlLine(number=number, indent=len(bare) - len(content), text=content))
        open_list.append(content.strip() if open_list else content)
        unclosed += content.count("[") - content.count("]")
        if unclosed <= 0:
            first = lines.pop()
            lines.append(_YamlLine(number=first.number, indent=first.indent, text=" ".join(open_list)))
            if unclosed < 0:
                raise _fault(where, lines[-1])
            open_list = []
    if open_list:
        raise _fault(where, lines[-1])
    return lines


def _without_comment(line: str) -> str:
    quote = ""
    for i, c in enumerate(line):
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c == "#" and (i == 0 or line[i - 1].isspace()):
            return line[:i]
    return line


def _block(lines: list[_YamlLine], start: int, where: str, depth: int) -> tuple[Any, int]:
    """Return the mapping or list that begins at line ``start``, and the line after it."""
    if depth > _DEEPEST:
        raise _fault(where, lines[start])
    indent = lines[start].indent
    if _is_item(lines[start]):
        return _items(lines, start, where, depth)
    keys: dict[str, Any] = {}
    i = start
    while i < len(lines) and lines[i].indent == indent and not _is_item(lines[i]):
        match = _KEY.match(lines[i].text)
        if match is None:
            raise _fault(where, lines[i])
        key = match["key"].rstrip().strip("\"'")
        if key in keys:
            raise IntrinsicsError(
                f"{where}, line {lines[i].number}", got=f"{quoted(key)} twice", wanted="each key once"
            )
        rest = re.sub(r"^!\S*\s*", "", match["rest"] or "")
        if rest:
            keys[key], i = _value(rest, where, lines[i]), i + 1
            continue
        i += 1
        deeper = i < len(lines) and (lines[i].indent > indent or (lines[i].indent == indent and _is_item(lines[i])))
        keys[key], i = _block(lines, i, where, depth + 1) if deeper else ("", i)
    if i < len(lines) and lines[i].indent > indent:
        raise _fault(where, lines[i])
    return keys, i


def _is_item(line: _YamlLine) -> bool:
    return line.text == "-" or line.text.startswith("- ")


def _items(lines: list[_YamlLine], start: int, where: str, depth: int) -> tuple[list[Any], int]:
    items: list[Any] = []
    i, indent = start, lines[start].indent
    while i < len(lines) and lines[i].indent == indent and _is_item(lines[i]):
        rest = lines[i].text[1:].strip()
        if _KEY.match(rest) or rest.startswith("- "):
            # the item is a separate block, which begins after the dash
            inner = lines[i].text[1:]
            shifted = _YamlLine(number=lines[i].number, indent=indent + 1 + len(inner) - len(inner.lstrip()), text=rest)
            lines[i] = shifted
            item, i = _block(lines, i, where, depth + 1)
        elif rest:
            item, i = _value(rest, where, lines[i]), i + 1
        elif i + 1 < len(lines) and lines[i + 1].indent > indent:
            item, i = _block(lines, i + 1, where, depth + 1)
        else:
            item, i = "", i + 1
        items.append(item)
    return items, i


def _value(text: str, where: str, line: _YamlLine) -> Any:
    """Return a number, a list or a string."""
    if not text.startswith("["):
        return _scalar(text)
    stack: list[list[Any]] = []
    for token in re.findall(r"""\[|\]|,|"[^"]*"|'[^']*'|[^\[\],\s][^\[\],]*""", text):
        if token == "[":
            new: list[Any] = []
            if stack:
                stack[-1].append(new)
            stack.append(new)
        elif token == "]":
            if len(stack) == 1:
                return stack[0] if text.endswith("]") else _refuse(where, line)
            stack.pop()
        elif token != ",":
            if len(stack) > _DEEPEST:
                raise _fault(where, line)
            stack[-1].append(_scalar(token.strip()))
    raise _fault(where, line)


def _refuse(where: str, line: _YamlLine) -> Any:
    raise _fault(where, line)


def _scalar(text: str) -> Any:
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    return float(text) if _NUMBER.match(text) else text
