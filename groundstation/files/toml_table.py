"""Reading typed values out of TOML tables, with errors that name the file and the key."""

import math
import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.errors import InputError, os_words, printable
from groundstation.files.nearest_word import one_of
from groundstation.files.text_file import TextFile, absence, is_utf16

MAX_TOML_BYTES = 4_000_000
# tomllib stores every prefix of a key: memory and time grow with the square of a key's parts; keys of this program
# have at most four
MAX_KEY_PARTS = 16
# strings and remarks, whole or cut off by the end: nothing in them is a key
_QUIET_PARTS = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5}|\Z)|\'{3}(?:[^']|'(?!''))*+(?:'{3,5}|\Z)'''
    r"""|"(?:[^"\\\n]|\\[^\n])*+["\\]?|'[^'\n]*+'?|\#[^\n]*+""",
    re.DOTALL,
)
_BETWEEN_KEYS = re.compile(r"[=,\[\]{}\n]")


def shown(text: str, most: int = 60) -> str:
    """Return a text from a file in a form for one line of an error: printable, cut at ``most`` characters."""
    clean = printable(text[: most + 1])
    return clean if len(clean) <= most else clean[: most - 1] + "…"


def quoted(value: object) -> str:
    """Return a value of a file as it fits into one line of an error, text in quotation marks."""
    try:
        return shown(repr(value))
    except ValueError:
        return "a whole number of thousands of digits"


def load_toml(path: TextFile, error: type[InputError]) -> dict[str, Any]:
    """Read one TOML file; raises `error` if it is missing, too large or not TOML."""
    if not path.is_file():
        raise error(str(path), got=absence(path), wanted="a TOML file")
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(MAX_TOML_BYTES + 1)
        if len(text) > MAX_TOML_BYTES:
            raise error(str(path), got="a larger file", wanted=f"at most {MAX_TOML_BYTES} bytes")
        parts = _most_key_parts(text)
        if parts > MAX_KEY_PARTS:
            raise error(str(path), got=f"a key of {parts} parts", wanted=f"keys of at most {MAX_KEY_PARTS}")
        values = tomllib.loads(text)
        _check_integers(values)
        return values
    except OSError as fault:
        raise error(str(path), got=os_words(fault), wanted="a file that can be read") from fault
    except (ValueError, RecursionError) as fault:
        if isinstance(fault, UnicodeDecodeError) and is_utf16(fault.object):
            raise error(str(path), got="text in UTF-16", wanted="a TOML file in UTF-8") from fault
        # a whole number of thousands of digits is a plain ValueError
        why = shown(str(fault), 200)
        if isinstance(fault, UnicodeDecodeError):
            why = f"no text: byte 0x{fault.object[fault.start]:02x} in place {fault.start}"
        raise error(str(path), got=f"not TOML ({why})", wanted="a TOML file") from fault


def _check_integers(values: dict[str, Any]) -> None:
    """Raise ValueError for an integer beyond 64 bits, which TOML does not have and Python may not print."""
    waiting: list[Any] = [values]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting.extend(value.values())
        elif isinstance(value, list):
            waiting.extend(value)
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise ValueError(f"an integer of {value.bit_length()} bits")


def _most_key_parts(text: str) -> int:
    """Return the parts of the longest key in a text, `a.b.c` having three; found without taking the text apart."""
    if text.count(".") < MAX_KEY_PARTS:
        return 1
    return 1 + max(piece.count(".") for piece in _BETWEEN_KEYS.split(_QUIET_PARTS.sub("", text)))


def finite_number(value: object) -> float | None:
    """Return a TOML number as a float, or None if it is no number, not finite or too large for a float."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    # comparing is safe where converting a whole number of many digits is not
    return float(value) if abs(value) <= sys.float_info.max else None


class TomlTable:
    """One TOML table with its place in the file, so that each error message names file and key."""

    def __init__(self, values: Mapping[str, Any], where: str, error: type[InputError]) -> None:
        if not isinstance(values, Mapping):
            raise error(where, got=quoted(values), wanted="a table")
        self.values = values
        self.where = where
        self.error = error

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def fail(self, key: str, got: str, wanted: str) -> InputError:
        """Build (not raise) the error for one key."""
        return self.error(f"{self.where}: {shown(key)}", got=got, wanted=wanted)

    def refuse_unknown(self, known: frozenset[str] | set[str]) -> None:
        """Raise if the table has a key that is not in ``known``."""
        for key in self.values:
            if key not in known:
                raise self.fail(key, "an unknown key", one_of(key, known))

    def _get(self, key: str, wanted: str) -> Any:
        if key not in self.values:
            raise self.fail(key, "nothing", wanted)
        return self.values[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a string; ``default`` None means that the key is required."""
        if key not in self.values and default is not None:
            return default
        value = self._get(key, "a string")
        if not isinstance(value, str):
            raise self.fail(key, quoted(value), "a string")
        return value

    def choice(self, key: str, words: Sequence[str], default: str | None = None) -> str:
        """Return one of ``words``; ``default`` None means that the key is required."""
        wanted = "one of " + ", ".join(repr(word) for word in words)
        if key not in self.values and default is not None:
            return default
        value = self._get(key, wanted)
        if value not in words:
            raise self.fail(key, quoted(value), wanted)
        return str(value)

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        minimum: float = -math.inf,
        above: float = -math.inf,
        maximum: float = math.inf,
    ) -> float:
        """Return a finite number at least ``minimum``, greater than ``above`` and at most ``maximum``."""
        if key not in self.values and default is not None:
            return default
        wanted = "a finite number"
        for sign, bound in (("≥", minimum), (">", above), ("≤", maximum)):
            if math.isfinite(bound):
                wanted += f" {sign} {bound:g}"
        value = self._get(key, wanted)
        number = finite_number(value)
        if number is None or not minimum <= number <= maximum or number <= above:
            raise self.fail(key, quoted(value), wanted)
        return number

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise self.fail(key, quoted(value), "true or false")
        return value

    def vector(
        self, key: str, length: int, default: tuple[float, ...] | None = None, *, names: str = ""
    ) -> NDArray[np.float64]:
        """Return ``length`` finite numbers as float64; ``names``, as in [fx, fy], is for the error message."""
        if key not in self.values and default is not None:
            return np.array(default, dtype=np.float64)
        wanted = f"{length} finite numbers" + (f", {names}" if names else "")
        value = self._get(key, wanted)
        numbers = [finite_number(v) for v in value] if isinstance(value, list) and len(value) == length else [None]
        if any(n is None for n in numbers):
            raise self.fail(key, quoted(value), wanted)
        return np.array(numbers, dtype=np.float64).reshape(length)

    def table(self, key: str) -> "TomlTable":
        """Return a sub-table, empty where the key is absent."""
        return TomlTable(self.values.get(key, {}), f"{self.where}: {shown(key)}", self.error)
