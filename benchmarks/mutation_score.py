"""How many faults the tests find: `make mutants`; the faults are listed in benchmarks/mutants/list.jsonl.

usage: python benchmarks/mutation_score.py [run] [--workers N] [--seconds S] [--again KEY|survived ...] [--only PACKAGE]
                                          [--tests FOLDER]
       python benchmarks/mutation_score.py map | score | resolve
       python benchmarks/mutation_score.py draw [--number N] [--seed N]

run: tries each fault of the list that has no result yet, and prints the score; map: which test calls what, for test
files that have changed (run does it first); score: the table of what is there; resolve: looks for each entry in the
program of today and reports those that are gone; draw: fills the list up to the number, those gone replaced.
Results are kept in out/mutants, so a stopped run is continued; `score --write` copies them to the
list.
Runs without the independent recordings, so faults that only they find are not found.
"""

import argparse
import gc
import importlib
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STORE = ROOT / "out" / "mutants"
MAP, IMPORTED, RESULTS = STORE / "map", STORE / "imported", STORE / "results.jsonl"
# Tests of sources or pages rather than of the program, and those of this tool.
LEFT_OUT = ("tests/docs", "tests/architecture", "tests/mutants", "tests/test_ci.py")
QUIET = ["-q", "-s", "-p", "no:cacheprovider", "-p", "no:xdist", "--no-header"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", default="run", choices=("run", "map", "score", "resolve", "draw"))
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="processor time of a fault's tests; kernels: 4 times"
    )
    parser.add_argument("--map-seconds", type=float, default=60.0, help="processor time of a test file when mapped")
    parser.add_argument("--again", nargs="+", default=[], help="keys, or 'survived': try these once more")
    parser.add_argument("--only", nargs="+", help="faults of these packages alone")
    parser.add_argument("--tests", nargs="+", type=Path, metavar="FOLDER", help="only tests below these folders")
    parser.add_argument("--number", type=int, default=320, help="faults on the list")
    parser.add_argument("--seed", type=int, default=22)
    parser.add_argument("--write", action="store_true", help="score: results are written into the list")
    options = parser.parse_args()
    os.chdir(ROOT)
    os.environ["GROUNDSTATION_DATA"] = str(STORE / "no-recordings")
    return {"run": run, "map": map_tests, "score": score, "resolve": resolve, "draw": draw_list}[options.what](options)


def draw_list(options: argparse.Namespace) -> int:
    from mutants.draw import draw
    from mutants.entries import LIST, Locator, read_list, write_list
    from mutants.places import read_functions

    functions = read_functions(ROOT)
    entries = read_list(LIST)
    located = [found for entry in entries if (found := Locator(functions).find(entry)) is not None]
    drawn = draw(functions.values(), number=options.number, seed=options.seed, root=ROOT, kept=located)
    write_list(LIST, drawn)
    print(f"{len(drawn)} faults, {len(located)} of them kept, {len(entries) - len(located)} gone and replaced")
    return 0


def resolve(options: argparse.Namespace) -> int:
    from mutants.entries import LIST, Locator, read_list
    from mutants.places import read_functions

    locator = Locator(read_functions(ROOT))
    entries = read_list(LIST)
    gone = [entry for entry in entries if locator.find(entry) is None]
    for entry in gone:
        print(f"gone: {entry.module}.{entry.function} {entry.kind} {entry.ordinal}: {entry.before}")
    print(f"{len(entries) - len(gone)} of {len(entries)} faults located")
    return 1 if gone else 0


def map_tests(options: argparse.Namespace) -> int:
    from mutants.coverage import is_known, keep, mark_all

    files = [file for file in test_files(options.tests) if not is_known(MAP, ROOT, file)]
    if not files:
        return 0
    if "MUTANTS_HITS" not in os.environ:
        mark_all(ROOT, IMPORTED)
        return subprocess.run([sys.executable, *sys.argv], check=False).returncode
    import pytest
    from mutants.coverage import Marker, map_jobs
    from mutants.session import ForkingSession, Work

    marker = Marker(IMPORTED)

    def jobs(items: dict[str, pytest.Item]) -> Iterable[Work]:
        return map_jobs(items, store=MAP, root=ROOT, marker=marker, budget_s=options.map_seconds)

    session = ForkingSession(jobs, workers=options.workers)
    code = int(pytest.main([*map(str, files), *QUIET], plugins=[session, marker]))
    # a file without collected tests (a peer that is not installed) is not used again until it changes
    for file in files if code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED) else []:
        if not is_known(MAP, ROOT, file):
            keep(MAP, ROOT, file, [])
    return 0 if code == pytest.ExitCode.NO_TESTS_COLLECTED else code


def test_files(folders: list[Path] | None) -> list[Path]:
    """All test files but those left out, or those of them below some folders."""
    out = tuple(ROOT / path for path in LEFT_OUT)
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    within = tuple(folder.resolve() for folder in folders or [ROOT])
    return [
        file
        for file in files
        if any(file.is_relative_to(path) for path in within) and not any(file.is_relative_to(path) for path in out)
    ]


def run(options: argparse.Namespace) -> int:
    mapping = [sys.executable, __file__, "map", f"--workers={options.workers}", f"--map-seconds={options.map_seconds}"]
    if options.tests is not None:
        mapping += ["--tests", *map(str, options.tests)]
    if subprocess.run(mapping, check=False).returncode:
        return 1
    import pytest
    from mutants.apply import function_objects
    from mutants.coverage import imported, read_map
    from mutants.entries import LIST, Locator, read_list, write_list
    from mutants.kernels import dispatchers
    from mutants.places import read_functions
    from mutants.score import FOUND, read_results
    from mutants.session import ForkingSession, Work
    from mutants.trial import Selection, trial

    locator = Locator(read_functions(ROOT))
    entries = read_list(LIST)
    located = [(entry, locator.find(entry)) for entry in entries]
    write_list(LIST, [entry if found is None else found.entry for entry, found in located])
    results = read_results(RESULTS)
    done = {key for key, result in results.items() if result.result in FOUND or "survived" not in options.again}
    done -= set(options.again)
    wanted = [
        found
        for _, found in located
        if found is not None
        and found.entry.key not in done
        and (options.only is None or found.entry.package in options.only)
    ]
    print(f"{len(wanted)} faults to try, {sum(found is None for _, found in located)} of the list gone", flush=True)
    at_import = imported(IMPORTED)

    def jobs(items: dict[str, pytest.Item]) -> Iterable[Work]:
        for found in wanted:
            importlib.import_module(found.function.module)
        function_objects(), dispatchers()
        # existing objects are never collected, so that forked processes do not copy them to count them
        gc.freeze()
        selection = Selection(read_map(MAP), items)
        for found in wanted:
            name = f"{found.function.module}:{found.function.name}"
            yield trial(found, selection, root=ROOT, budget_s=options.seconds, imported=name in at_import, into=RESULTS)

    if wanted and (
        code := int(
            pytest.main(
                [*map(str, test_files(options.tests)), *QUIET], plugins=[ForkingSession(jobs, workers=options.workers)]
            )
        )
    ):
        return code
    return score(options)


def score(options: argparse.Namespace) -> int:
    from mutants.entries import LIST, read_list, write_list
    from mutants.score import read_results, table, with_results

    entries = with_results(read_list(LIST), read_results(RESULTS))
    print(table(entries))
    if options.write:
        write_list(LIST, entries)
    return 0


if __name__ == "__main__":
    sys.exit(main())
