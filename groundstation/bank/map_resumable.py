"""Parallel map of a function over items, on all cores or a cluster, resumable after an interruption.

    found = map_resumable(fly, {"seed-7": 7, "seed-8": 8}, Path("out/study"))

Finished results are in the folder ``out``, one file each; a killed run loses its workers' unfinished items only.
A dead worker is replaced, and its job repeated. Jobs take a second or more: each is a message and a file.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from groundstation.bank.cluster import open_cluster, require_dask, usable_cores
from groundstation.bank.dispatcher import Dispatcher, FinishedJob, JobFailure
from groundstation.bank.program_version import identity_of
from groundstation.bank.result_store import JobResult, ResultStore
from groundstation.errors import InputError
from groundstation.files.new_folder import make_folder
from groundstation.files.output_names import name_fault

ItemT = TypeVar("ItemT")
_TRACES = "traces"


@dataclass(frozen=True, slots=True, kw_only=True)
class MapOutcome:
    """Results and failures in the order of the items; ``reused`` of the results stood in the folder already."""

    results: tuple[JobResult, ...]
    failures: tuple[JobFailure, ...]
    reused: int


def map_resumable(
    function: Callable[[ItemT], Any],
    items: Mapping[str, ItemT],
    out: Path,
    workers: int | None = None,
    scheduler: str | None = None,
    *,
    settings: str = "",
    limit_s: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> MapOutcome:
    """Return ``function`` of every item, done now or found in ``out``.

    Parameters
    ----------
    function : importable on the workers, or of a script; returns what JSON has: numbers, text, lists, mappings by text.
    items : by name; names are of files.
    out : folder of the finished results.
    workers : processes of this machine (default: one for each core).
    scheduler : address of a Dask scheduler with workers of one thread each; then ``workers`` is not used.
    settings : what else the results depend on; results of other settings, or of another program, are not used again.
    limit_s : longest time of one job, s; it is reported as failed then.
    progress : called with the number of items that have ended and of all.

    Raises `MissingExtraError` without Dask, `InputError` for names that are none of files, or without a worker. A job
    that raises, or that ends its workers, is a failure of the outcome and stops nothing; a later run tries it again.
    """
    for name in items:
        fault = name_fault(name)
        if fault is not None:
            raise InputError("items", got=fault, wanted="plain file names")
    store = ResultStore(out, identity_of(function, settings))
    found = {name: result for name in items if (result := store.find(name)) is not None}
    reused, failed = len(found), dict[str, JobFailure]()
    progress(reused, len(items))
    waiting = {name: item for name, item in items.items() if name not in found}
    if waiting:
        require_dask()
        traces = out / _TRACES
        make_folder(traces)
        count = min(workers or usable_cores(), len(waiting))
        with open_cluster(count, scheduler) as client:
            dispatcher = Dispatcher(client, function, waiting.items(), limit_s=limit_s, traces=traces.resolve())
            for end in dispatcher.ends():
                if isinstance(end, FinishedJob):
                    found[end.name] = _kept(store, end)
                else:
                    failed[end.name] = end
                progress(len(found) + len(failed), len(items))
    return MapOutcome(
        results=tuple(found[name] for name in items if name in found),
        failures=tuple(failed[name] for name in items if name in failed),
        reused=reused,
    )


def _kept(store: ResultStore, end: FinishedJob) -> JobResult:
    """Write a result, and return it as a later run reads it."""
    result = JobResult(name=end.name, value=json.loads(end.text), elapsed_s=end.elapsed_s, cpu_s=end.cpu_s)
    store.write(result)
    return result
