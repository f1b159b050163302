"""Dispatch of jobs to Dask's workers, one each: detection of workers that died or exceed their time, and retries."""

import queue
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from groundstation.bank.program_version import program_digest
from groundstation.bank.watched_job import last_place, run_job, timed_out
from groundstation.compilation import Compiling, report
from groundstation.errors import InputError
from groundstation.files.output_names import below

if TYPE_CHECKING:
    from distributed import Client, Future

_POLL_S = 0.5
# a worker ends itself at the limit, but not if it is stopped or its machine hangs
_GRACE_S = 30.0
_NO_WORKER_S = 120.0
# a worker may be killed for memory that another process took; a job with which three have ended is at fault itself
MOST_DEATHS = 3


class FailureKind(StrEnum):
    """Kind of a job's failure."""

    RAISED = "raised"
    DIED = "died"
    TIMED_OUT = "timed out"


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFailure:
    """A job without a result, and why."""

    name: str
    kind: FailureKind
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedJob:
    """Result of a job: its value as JSON text, its wall time and its processor time, s."""

    name: str
    text: str
    elapsed_s: float
    cpu_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Running:
    name: str
    address: str
    future: "Future[Any]"
    since_s: float


class Dispatcher:
    """Hands jobs to workers, one at a time each, so that a death has one job as its reason.

    Parameters
    ----------
    client : of a scheduler with workers of one thread.
    function : applied to each item.
    items : by name.
    limit_s : longest time of one job, s.
    traces : folder where workers of this machine write what they did when they end.
    """

    def __init__(
        self,
        client: "Client",
        function: Callable[[Any], Any],
        items: Iterable[tuple[str, Any]],
        *,
        limit_s: float | None,
        traces: Path,
    ) -> None:
        self._client = client
        self._function = function
        self._items = dict(items)
        self._waiting = deque(self._items)
        self._running: dict[str, _Running] = {}
        self._done: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._deaths = dict.fromkeys(self._items, 0)
        self._abandoned: set[str] = set()
        self._limit_s = limit_s
        self._traces = traces
        self._served_s = time.monotonic()
        self._topic = f"compiling-{uuid.uuid4().hex}"
        self._compiled: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        # of the workers, which compile the same kernels, one is shown
        self._compiler: str | None = None
        client.subscribe_topic(self._topic, lambda event: self._compiled.put(event[1]))

    def ends(self) -> Iterator[FinishedJob | JobFailure]:
        """Yield each job's end as it comes; raises `InputError` where no worker is left."""
        while self._waiting or self._running:
            addresses = self._addresses()
            self._assign(addresses)
            yield from self._collect()
            self._show_compilation()
            yield from self._lost(addresses)

    def _addresses(self) -> set[str]:
        """Return the workers that can be used; raises `InputError` for one of several threads."""
        threads: dict[str, int] = self._client.nthreads()
        for address, number in threads.items():
            if number != 1:
                wanted = "workers of one thread: dask worker --nthreads 1"
                raise InputError(f"worker {address}", got=f"{number} threads", wanted=wanted)
        usable = set(threads) - self._abandoned
        if usable:
            self._served_s = time.monotonic()
        elif time.monotonic() - self._served_s > _NO_WORKER_S:
            raise InputError("workers", got=f"none for {_NO_WORKER_S:.0f} s", wanted="at least one")
        return usable

    def _assign(self, addresses: set[str]) -> None:
        """Give each idle worker a job, and that job to no other worker."""
        busy = {running.address for running in self._running.values()}
        for address in sorted(addresses - busy):
            if not self._waiting:
                return
            name = self._waiting.popleft()
            future = self._client.submit(
                run_job,
                self._function,
                self._items[name],
                self._limit_s,
                program_digest(),
                self._trace(name),
                self._topic,
                workers=[address],
                allow_other_workers=False,
                pure=False,
            )
            self._running[str(future.key)] = _Running(
                name=name, address=address, future=future, since_s=time.monotonic()
            )
            future.add_done_callback(lambda done: self._done.put(str(done.key)))

    def _collect(self) -> Iterator[FinishedJob | JobFailure]:
        """Yield the jobs that have ended, after a short wait for the first."""
        wait_s = _POLL_S
        while True:
            try:
                key = self._done.get(timeout=wait_s)
            except queue.Empty:
                return
            wait_s = 0.001
            running = self._running.pop(key, None)
            if running is not None:
                yield from self._ended(running)

    def _show_compilation(self) -> None:
        """Tell the display what a worker compiles."""
        while not self._compiled.empty():
            told = self._compiled.get()
            worker = told.pop("worker")
            self._compiler = self._compiler or worker
            if worker == self._compiler:
                report(Compiling(**told))

    def _ended(self, running: _Running) -> Iterator[FinishedJob | JobFailure]:
        from distributed import KilledWorker

        if running.future.status != "finished":
            fault = running.future.exception() if running.future.status == "error" else None
            if fault is not None and not isinstance(fault, KilledWorker):
                # not an error of the function, which would be returned: the workers cannot run it
                raise fault
            yield from self._died(running)
            return
        found = running.future.result()
        if "fault" in found:
            yield JobFailure(name=running.name, kind=FailureKind.RAISED, reason=found["fault"])
            return
        yield FinishedJob(name=running.name, text=found["value"], elapsed_s=found["elapsed_s"], cpu_s=found["cpu_s"])

    def _lost(self, addresses: set[str]) -> Iterator[FinishedJob | JobFailure]:
        """Yield the jobs of workers that died or exceeded their time without ending."""
        now_s = time.monotonic()
        for key, running in list(self._running.items()):
            overdue = self._limit_s is not None and now_s - running.since_s > self._limit_s + _GRACE_S
            if running.address in addresses and not overdue:
                continue
            if running.future.status == "finished":
                # its callback is on its way
                continue
            del self._running[key]
            running.future.cancel()
            if overdue:
                self._abandoned.add(running.address)
            yield from self._died(running, overdue)

    def _died(self, running: _Running, overdue: bool = False) -> Iterator[JobFailure]:
        """Requeue the job of a dead worker, or yield it as failed."""
        trace = self._trace(running.name)
        place, late = last_place(trace), timed_out(trace)
        trace.unlink(missing_ok=True)
        shown = f" ({place})" if place else ""
        if late is None:
            late = self._limit_s is not None and time.monotonic() - running.since_s >= self._limit_s
        if late or overdue:
            reason = f"took longer than {self._limit_s:g} s{shown}"
            yield JobFailure(name=running.name, kind=FailureKind.TIMED_OUT, reason=reason)
            return
        self._deaths[running.name] += 1
        if self._deaths[running.name] < MOST_DEATHS:
            self._waiting.append(running.name)
            return
        reason = f"its worker ended {MOST_DEATHS} times{shown}"
        yield JobFailure(name=running.name, kind=FailureKind.DIED, reason=reason)

    def _trace(self, name: str) -> Path:
        return below(self._traces, f"{name}.trace")
