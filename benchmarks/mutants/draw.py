"""Draw of the listed faults by hash, stratified over the packages.

Each package (a folder of ``groundstation``, its flat modules together, ``calibration``, ``ptu_drivers``) gets its share
of the number of faults by its lines in functions, and at least `AT_LEAST`. Within a package the functions are ranked by
the SHA-256 of seed, module and qualified name, and the first of them get one fault each: first its kind is drawn, the
one whose hash with the function is lowest among the kinds that the function has, then its place among those of the kind
in the same way. A draw therefore depends only on the seed and the program, a new function moves at most one fault, and
where a listed fault is gone the next function of the package's ranking takes its place.

Left out of the draw: messages, log lines, assertions, docstrings, annotations, ``__repr__``, the appearance of plots,
the text of tests and benchmarks, module-level constants, faults that compile to the same instructions, and floats
below 1e-6 (guards against a division by zero). Nothing is left out for being hard to find.
"""

import hashlib
from collections import defaultdict
from collections.abc import Collection, Iterable
from pathlib import Path

from mutants.apply import changed_code
from mutants.entries import Entry, Located, new_entry
from mutants.places import Fault, Function

AT_LEAST = 8


def shares(lines: dict[str, int], number: int, at_least: int = AT_LEAST) -> dict[str, int]:
    """How many faults each package gets: `at_least`, and of the rest its share by lines (largest remainders).

    >>> shares({"large": 900, "small": 100}, 30, at_least=5)
    {'large': 23, 'small': 7}
    """
    rest = number - at_least * len(lines)
    if rest < 0:
        raise ValueError(f"{number} faults are fewer than {at_least} for each of {len(lines)} packages")
    exact = {package: rest * count / sum(lines.values()) for package, count in lines.items()}
    given = {package: at_least + int(share) for package, share in exact.items()}
    by_remainder = sorted(exact, key=lambda package: (int(exact[package]) - exact[package], package))
    for package in by_remainder[: number - sum(given.values())]:
        given[package] += 1
    return given


def draw(
    functions: Iterable[Function], *, number: int, seed: int, root: Path, kept: Collection[Located] = ()
) -> list[Entry]:
    """The list: `kept` faults stay, and each package is filled up to its share from its ranking."""
    by_package: dict[str, list[Function]] = defaultdict(list)
    for function in functions:
        by_package[function.package].append(function)
    lines = {package: sum(function.lines for function in those) for package, those in by_package.items()}
    entries = [located.entry for located in kept]
    taken = {(entry.module, entry.function) for entry in entries}
    for package, share in sorted(shares(lines, number).items()):
        missing = share - sum(entry.package == package for entry in entries)
        ranked = sorted(by_package[package], key=lambda function: _hash(seed, function.module, function.name))
        for function in ranked:
            if missing <= 0:
                break
            if (function.module, function.name) in taken or (fault := chosen(function, seed, root)) is None:
                continue
            entries.append(new_entry(function, fault))
            missing -= 1
    return entries


def chosen(function: Function, seed: int, root: Path) -> Fault | None:
    """The function's fault: its kind by hash, then its place by hash; None when it has none that changes its code."""
    by_kind: dict[str, list[Fault]] = defaultdict(list)
    for fault in function.faults:
        by_kind[fault.kind].append(fault)
    where = (function.module, function.name)
    for kind in sorted(by_kind, key=lambda kind: _hash(seed, *where, kind)):
        places = by_kind[kind]
        for fault in sorted(
            places, key=lambda fault: _hash(seed, *where, kind, fault.before, fault.after, fault.ordinal)
        ):
            if changed_code(root, function, fault) is not None:
                return fault
    return None


def _hash(*parts: object) -> str:
    return hashlib.sha256("\n".join(str(part) for part in parts).encode()).hexdigest()
