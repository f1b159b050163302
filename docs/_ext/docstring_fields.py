"""Docstrings whose fields have their description on the field's own line, for Sphinx.

Here a field is written `name : (n, 3) what it is`. Napoleon takes what follows the colon for a type; this moves it to a
line of its own, before Napoleon reads the docstring.
"""

import re
from typing import Any

from sphinx.application import Sphinx

_UNDERLINE = re.compile(r"-{3,}$")
_FIELD = re.compile(r"(?P<names>\w+(, \w+)*) : (?P<text>.*)")
# Napoleon's own handler has 500
_BEFORE_NAPOLEON = 400


def split_fields(lines: list[str]) -> list[str]:
    """Return the lines of a docstring with the descriptions of fields on lines of their own."""
    split: list[str] = []
    in_section = False
    for line in lines:
        in_section = in_section or bool(_UNDERLINE.match(line))
        field = _FIELD.fullmatch(line) if in_section else None
        split += [line] if field is None else [field["names"], "    " + field["text"]]
    return split


def _process(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    lines[:] = split_fields(lines)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the hook with Sphinx."""
    app.connect("autodoc-process-docstring", _process, priority=_BEFORE_NAPOLEON)
    return {"parallel_read_safe": True}
