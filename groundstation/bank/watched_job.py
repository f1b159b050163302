"""One job on a worker: its time limited, its faults returned, and where it stood when the process ended."""

import faulthandler
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from groundstation.bank.program_version import program_digest
from groundstation.compilation import Compiling, compilation_sent
from groundstation.errors import GroundstationError, printable

_SHOWN_CHARACTERS = 300
_busy = threading.Lock()


class WorkerMismatchError(GroundstationError):
    """A worker cannot execute its job: its program differs, or it has more than one thread."""


def run_job(
    function: Callable[[Any], Any], item: Any, limit_s: float | None, program: str, trace: Path, topic: str
) -> dict[str, Any]:
    """Return ``value`` (JSON text), ``elapsed_s`` and ``cpu_s`` of a job, or its ``fault`` in words.

    Runs on a worker. A job that takes longer than ``limit_s`` ends its worker: nothing else ends compiled code. If the
    coordinator's folder can be reached from here, ``trace`` then has what the job did. What is compiled is told as
    Dask's events of ``topic``. Raises `WorkerMismatchError`.
    """
    if program_digest() != program:
        raise WorkerMismatchError("the workers have another version of the program than this one; wanted the same")
    with _watched(limit_s, trace), _compilation_told(topic):
        began_s, cpu_began_s = time.perf_counter(), time.process_time()
        try:
            text = json.dumps(function(item), ensure_ascii=False)
        except (Exception, SystemExit) as fault:  # noqa: BLE001 - one job's fault is a row of the table, not the end
            return {"fault": fault_in_words(fault)}
        return {
            "value": text,
            "elapsed_s": time.perf_counter() - began_s,
            "cpu_s": time.process_time() - cpu_began_s,
        }


def fault_in_words(fault: BaseException) -> str:
    """Return an exception as one line, with the place where it was raised."""
    said = f"{type(fault).__name__}: {fault}" if str(fault) else type(fault).__name__
    last = fault.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    place = "" if last is None else f" ({_short(last.tb_frame.f_code.co_filename)}:{last.tb_lineno})"
    return printable(said[:_SHOWN_CHARACTERS]) + place


def last_place(trace: Path) -> str:
    """Return in words what a worker that ended was doing, from its trace; empty where it left none."""
    try:
        text = trace.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    crash = next((line for line in text.splitlines() if line.startswith("Fatal")), "")
    # a paragraph for each thread, the call made last first
    thread = next((part for part in text.split("\n\n") if " in run_job" in part), "")
    place = next((line.strip() for line in thread.splitlines() if line.startswith("  File ")), "")
    return printable("; ".join(part for part in (crash, place) if part))


def timed_out(trace: Path) -> bool | None:
    """Return whether a worker ended by its time limit; None if its trace cannot be read."""
    try:
        text = trace.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    return "Timeout (" in text


@contextmanager
def _compilation_told(topic: str) -> Iterator[None]:
    """Tell the coordinator of the kernels that are compiled meanwhile; a job of none has not imported numba."""
    if "numba" not in sys.modules:
        yield
        return
    from distributed import get_worker

    worker = get_worker()

    def send(what: Compiling) -> None:
        worker.log_event(topic, {"worker": worker.address, **asdict(what)})

    with compilation_sent(send):
        yield


@contextmanager
def _watched(limit_s: float | None, trace: Path) -> Iterator[None]:
    """End this process at the time limit or a crash, with its stack trace in a file."""
    if not _busy.acquire(blocking=False):
        raise WorkerMismatchError("got two jobs in one process; wanted workers of one thread: dask worker --nthreads 1")
    shared = trace.parent.is_dir()
    try:
        with trace.open("w") if shared else open(os.devnull, "w") as file:  # noqa: PTH123 - a device
            faulthandler.enable(file)
            if limit_s is not None:
                faulthandler.dump_traceback_later(limit_s, exit=True, file=file)
            try:
                yield
            finally:
                faulthandler.cancel_dump_traceback_later()
                faulthandler.disable()
    finally:
        _busy.release()
        if shared:
            trace.unlink(missing_ok=True)


def _short(path: str) -> str:
    """Return the last two parts of a path."""
    return "/".join(Path(path).parts[-2:])
