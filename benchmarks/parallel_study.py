"""Studies as jobs on all cores: finished ones are kept in a folder, and an interrupted study is continued.

A study's jobs are fixed by its options and not by the number of workers, and their values are returned in the order of
the jobs: the figures are those of one process. Measured times are of a machine as busy as the study's workers make it;
`--workers 1` measures undisturbed.
"""

import argparse
import hashlib
import importlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from groundstation.bank.map_resumable import map_resumable
from groundstation.bank.program_version import identity_of
from groundstation.bank.result_store import JobResult, ResultStore
from groundstation.cli.number_arguments import count
from groundstation.cli.progress import ProgressLine
from groundstation.errors import GroundstationError, MissingExtraError

ItemT = TypeVar("ItemT")
SeedT = TypeVar("SeedT")
_FOLDER = Path(__file__).resolve().parent
# folder of finished jobs
STUDIES = _FOLDER.parent / "out" / "studies"
_DIGEST_CHARACTERS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRun:
    """How a study runs: its name, the folder of finished jobs, processes here, or a Dask scheduler's address."""

    name: str
    out: Path
    workers: int | None
    scheduler: str | None

    @classmethod
    def chosen(cls, name: str, options: argparse.Namespace, out: Path | None = None) -> "StudyRun":
        """Return what `add_study_arguments` has parsed; ``out`` instead of its own folder."""
        folder = options.out if out is None else out
        return cls(name=name, out=folder, workers=options.workers, scheduler=options.scheduler)

    def values(self, function: Callable[[ItemT], Any], items: Mapping[str, ItemT]) -> dict[str, Any]:
        """Return ``function`` of every item, by name, in the order of the items.

        Items and values are what JSON has. A value is used again for the same item, program and scripts. Without
        Dask the jobs run one after the other. Ends the program if a job fails or is interrupted; the others are kept.
        """
        function, settings = _importable(function), _scripts_digest(function)
        named = {f"{name}-{_digest([json.dumps(item).encode()])}": item for name, item in items.items()}
        try:
            with ProgressLine(sys.stderr, self.name, "job") as line:
                try:
                    found = map_resumable(
                        function,
                        named,
                        self.out,
                        self.workers,
                        self.scheduler,
                        settings=settings,
                        progress=line.update,
                    )
                except MissingExtraError as error:
                    print(f"{error}; until then one job runs after the other", file=sys.stderr)
                    store = ResultStore(self.out, identity_of(function, settings))
                    values = list(_one_by_one(function, named, store, line))
                    return dict(zip(items, values, strict=True))
        except KeyboardInterrupt:
            print(f"interrupted; the same command goes on with what is in {self.out}", file=sys.stderr)
            raise SystemExit(130) from None
        except GroundstationError as error:
            raise SystemExit(str(error)) from error
        for failure in found.failures:
            print(f"{failure.name}: {failure.kind.value}: {failure.reason}", file=sys.stderr)
        if found.failures:
            raise SystemExit(f"{len(found.failures)} of {len(items)} jobs failed; the others are kept in {self.out}")
        return dict(zip(items, (result.value for result in found.results), strict=True))


def add_study_arguments(parser: argparse.ArgumentParser, name: str, *, out: bool = True) -> None:
    """Add `--workers` and `--scheduler`, and `--out` unless the study has one of its own."""
    parser.add_argument("--workers", type=count, metavar="N", help="processes (default: one for each core)")
    needed = "whose workers have the repository and benchmarks/ on their PYTHONPATH"
    parser.add_argument("--scheduler", metavar="ADDRESS", help=f"a Dask scheduler, {needed}")
    if out:
        parser.add_argument("--out", type=Path, default=STUDIES / name, help="where finished jobs are kept")


def as_json(record: Any) -> Any:
    """Return a dataclass's record as JSON has it: fields by name, arrays as lists."""
    return json.loads(json.dumps(asdict(record), default=_as_list))


def in_blocks(seeds: Sequence[SeedT], size: int) -> list[list[SeedT]]:
    """Return the seeds in blocks, so that a job takes seconds; the size is the study's, not the machine's."""
    return [list(seeds[k : k + size]) for k in range(0, len(seeds), size)]


def _as_list(value: "np.ndarray[Any, Any] | np.generic") -> Any:
    return value.tolist()


def _one_by_one(
    function: Callable[[ItemT], Any], items: Mapping[str, ItemT], store: ResultStore, line: ProgressLine
) -> Iterator[Any]:
    for done, (name, item) in enumerate(items.items()):
        line.update(done, len(items))
        if store.find(name) is None:
            began_s, cpu_began_s = time.perf_counter(), time.process_time()
            value = function(item)
            elapsed_s, cpu_s = time.perf_counter() - began_s, time.process_time() - cpu_began_s
            store.write(JobResult(name=name, value=value, elapsed_s=elapsed_s, cpu_s=cpu_s))
        result = store.find(name)
        if result is None:
            raise OSError(f"{store.folder}: got no result of {name} back; wanted the one just written")
        yield result.value
    line.update(len(items), len(items))


def _importable(function: Callable[[ItemT], Any]) -> Callable[[ItemT], Any]:
    """Return the function of a script as that of its module, which a worker imports once and not for each job."""
    if function.__module__ != "__main__":
        return function
    script = sys.modules["__main__"].__file__
    if script is None:
        raise ValueError(f"got the function {function.__qualname__} of no file; wanted one of a script")
    found: Callable[[ItemT], Any] = getattr(importlib.import_module(Path(script).stem), function.__qualname__)
    return found


def _scripts_digest(function: Callable[..., Any]) -> str:
    """Return a digest of the inputs of a study's values besides the program: benchmarks/, and parts of the tests."""
    module = sys.modules[function.__module__]
    owners = {v.__name__ if isinstance(v, ModuleType) else getattr(v, "__module__", "") for v in vars(module).values()}
    tests = [sys.modules[owner].__file__ for owner in owners if owner.startswith("tests.")]
    paths = [*sorted(_FOLDER.rglob("*.py")), *(Path(path) for path in sorted(filter(None, tests)))]
    return _digest([path.read_bytes() for path in paths])


def _digest(parts: Sequence[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()[:_DIGEST_CHARACTERS]
