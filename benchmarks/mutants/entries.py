"""The committed list of faults, and how each is found again in the program of today."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from mutants.places import Fault, Function

LIST = Path(__file__).parent / "list.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One fault of the list: its place, its change, and its result.

    Attributes
    ----------
    package : stratum that it was drawn from
    module, function : dotted module and qualified name
    shape : hash of the function's body with all names erased
    kind, ordinal : rule, and the place among the function's faults of that kind
    before, after : source of the changed node and of what replaces it
    result : "found", "timeout", "survived", or empty before the first run
    by : test that found it
    explained : reason why no test can find it or need not
    """

    package: str
    module: str
    function: str
    shape: str
    kind: str
    ordinal: int
    before: str
    after: str
    result: str = ""
    by: str = ""
    explained: str = ""

    @property
    def key(self) -> str:
        """What its results are kept under."""
        text = "\n".join((self.module, self.function, self.kind, str(self.ordinal), self.before, self.after))
        return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """A listed fault in the program of today."""

    entry: Entry
    function: Function
    fault: Fault


class Locator:
    """Finds listed faults again, by the first rule that leaves exactly one function.

    1. the module and the qualified name are the same;
    2. the qualified name is the same in another module (a move);
    3. the body with its names erased is the same (renaming, of the function or within it).

    Within the function the fault has the same kind and the same source before and after; of several the one with the
    nearest ordinal. Where the names within have changed, it is the fault with the same ordinal, if erased of its names
    the function is the same.
    """

    def __init__(self, functions: dict[tuple[str, str], Function]) -> None:
        self._functions = functions
        self._by_name: dict[str, list[Function]] = defaultdict(list)
        for function in functions.values():
            self._by_name[function.name].append(function)
        self._by_shape: dict[str, list[Function]] | None = None

    def find(self, entry: Entry) -> Located | None:
        """The listed fault, None when the place is gone; the entry returned names the place of today."""
        for candidates in (self._same_place(entry), self._by_name[entry.function], self._same_shape(entry)):
            matches = [(function, fault) for function in candidates if (fault := _fault_in(function, entry))]
            if len(matches) == 1:
                (function, fault) = matches[0]
                return Located(entry=_renewed(entry, function, fault), function=function, fault=fault)
        return None

    def _same_place(self, entry: Entry) -> list[Function]:
        function = self._functions.get((entry.module, entry.function))
        return [] if function is None else [function]

    def _same_shape(self, entry: Entry) -> list[Function]:
        if self._by_shape is None:
            self._by_shape = defaultdict(list)
            for function in self._functions.values():
                self._by_shape[function.shape].append(function)
        return self._by_shape[entry.shape]


def _fault_in(function: Function, entry: Entry) -> Fault | None:
    same_kind = [fault for fault in function.faults if fault.kind == entry.kind]
    same_text = [fault for fault in same_kind if (fault.before, fault.after) == (entry.before, entry.after)]
    if same_text:
        return min(same_text, key=lambda fault: abs(fault.ordinal - entry.ordinal))
    if function.shape == entry.shape and entry.ordinal < len(same_kind):
        return same_kind[entry.ordinal]
    return None


def _renewed(entry: Entry, function: Function, fault: Fault) -> Entry:
    return replace(new_entry(function, fault), result=entry.result, by=entry.by, explained=entry.explained)


def new_entry(function: Function, fault: Fault) -> Entry:
    """The list's line for a fault that nothing is known of yet."""
    return Entry(
        package=function.package,
        module=function.module,
        function=function.name,
        shape=function.shape,
        kind=fault.kind,
        ordinal=fault.ordinal,
        before=fault.before,
        after=fault.after,
    )


def read_list(file: Path) -> list[Entry]:
    """The entries of a list, one JSON object a line; empty when there is no file."""
    if not file.exists():
        return []
    return [Entry(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def write_list(file: Path, entries: Iterable[Entry]) -> None:
    """Write a list in the order of package, module and function."""
    ordered = sorted(entries, key=lambda entry: (entry.package, entry.module, entry.function))
    lines = (json.dumps(asdict(entry), ensure_ascii=False) for entry in ordered)
    file.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
