"""One pytest session that has everything imported and collected, and forks a process for each run of some tests."""

import contextlib
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

# A test may take this many times as long as without the fault, and this much more, before it counts as hanging. What
# loops uses processor time; what waits for ever does not, and a machine that others use may be twenty times slower.
TIMES_CPU, MORE_CPU_S = 10.0, 20.0
TIMES_WALL, MORE_WALL_S = 100.0, 600.0
_LIMITS = (signal.SIGPROF, signal.SIGALRM)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What one forked process does.

    Attributes
    ----------
    items : tests in their order, with the processor and wall time that each may take, seconds
    prepare : called in the forked process before the tests, with its own scratch folder
    budget_s : no further test begins after this much processor time, nor after four times as much wall time
    until_failure : end with the first test that fails
    """

    items: Sequence[tuple[pytest.Item, float, float]]
    prepare: Callable[[Path], object]
    budget_s: float
    until_failure: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class PytestOutcome:
    """Outcome of a test run.

    Attributes
    ----------
    lines : the process's output for each test
    failed : the test that failed, hung or ended the process, None when none did
    how : "failed", "timeout" or "died"; "prepare" when it failed before any test, empty when nothing failed
    complete : whether all requested tests ran, the failing one included
    seconds : wall time
    """

    lines: tuple[dict[str, Any], ...]
    failed: str | None
    how: str
    complete: bool
    seconds: float


Work = Generator[Run, PytestOutcome, None]


class ForkingSession:
    """A pytest plugin that hands over the collected tests and runs some of them in forked processes.

    Parameters
    ----------
    jobs : called once with all collected tests by their names; gives generators that yield runs and get their results
    workers : how many processes at a time
    """

    def __init__(self, jobs: Callable[[dict[str, pytest.Item]], Iterable[Work]], *, workers: int) -> None:
        self._jobs = jobs
        self._workers = workers
        self.reports: list[pytest.TestReport] = []

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Take the place of pytest's own loop."""
        if session.testsfailed:
            raise session.Interrupted(f"{session.testsfailed} errors in the collection of the tests")
        items = {item.nodeid: item for item in session.items}
        serve(iter(self._jobs(items)), workers=self._workers, start=self._start)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep what pytest reports of each test's parts."""
        self.reports.append(report)

    def _start(self, run: Run, folder: Path) -> int:
        sys.stdout.flush()
        sys.stderr.flush()
        if pid := os.fork():
            return pid
        try:
            os.setsid()
            with (folder / "output").open("wb") as output:
                os.dup2(output.fileno(), 1)
                os.dup2(output.fileno(), 2)
            (folder / "tmp").mkdir()
            os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "tmp")
            if run.items:
                run.items[0][0].config._tmp_path_factory._basetemp = folder / "tmp"  # type: ignore[attr-defined]
            self._run(run, folder)
        finally:
            os._exit(0)

    def _run(self, run: Run, folder: Path) -> None:
        begun = time.monotonic()
        with (folder / "lines").open("a", encoding="utf-8", buffering=1) as lines:
            try:
                run.prepare(folder)
            except BaseException as error:
                lines.write(json.dumps({"prepare": repr(error)}) + "\n")
                raise
            used_before = time.process_time()
            for place, (item, cpu_s, wall_s) in enumerate(run.items):
                if time.process_time() - used_before > run.budget_s or time.monotonic() - begun > 4 * run.budget_s:
                    lines.write(json.dumps({"stopped": True}) + "\n")
                    return
                lines.write(json.dumps({"begin": item.nodeid}) + "\n")
                following = run.items[place + 1][0] if place + 1 < len(run.items) else None
                outcome = self._run_one(item, following, cpu_s, wall_s)
                lines.write(json.dumps(outcome) + "\n")
                if run.until_failure and outcome["outcome"] == "failed":
                    return

    def _run_one(self, item: pytest.Item, following: pytest.Item | None, cpu_s: float, wall_s: float) -> dict[str, Any]:
        self.reports.clear()
        begun, used = time.monotonic(), time.process_time()
        for number, timer, limit in zip(
            _LIMITS, (signal.ITIMER_PROF, signal.ITIMER_REAL), (cpu_s, wall_s), strict=True
        ):
            # the system ends the process, so that a loop in compiled code ends too
            signal.signal(number, signal.SIG_DFL)
            signal.setitimer(timer, limit)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0)
        outcomes = {report.outcome for report in self.reports}
        outcome = next((name for name in ("failed", "skipped") if name in outcomes), "passed")
        cpu, wall = time.process_time() - used, time.monotonic() - begun
        extra = {key: value for key, value in item.user_properties if key == "mutants"}
        return {"end": item.nodeid, "outcome": outcome, "cpu": round(cpu, 3), "wall": round(wall, 3), **extra}


def serve(jobs: Iterator[Work], *, workers: int, start: Callable[[Run, Path], int]) -> None:
    """Run all jobs, `workers` processes at a time; each job gets the result of its run and may yield another."""
    running: dict[int, tuple[Work, Path, float]] = {}

    def launch(job: Work, run: Run) -> None:
        folder = Path(tempfile.mkdtemp(prefix="mutants-"))
        running[start(run, folder)] = (job, folder, time.monotonic())

    try:
        while True:
            while len(running) < workers and (job := next(jobs, None)) is not None:
                if (run := next(job, None)) is not None:
                    launch(job, run)
            if not running:
                return
            pid, status = os.waitpid(-1, 0)
            if pid not in running:
                continue
            job, folder, begun = running.pop(pid)
            _end_group(pid)
            ran = _read(folder, status, time.monotonic() - begun)
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(StopIteration):
                launch(job, job.send(ran))
    finally:
        for pid, (_, folder, _) in running.items():
            _end_group(pid)
            shutil.rmtree(folder, ignore_errors=True)


def _end_group(pid: int) -> None:
    """End the remaining processes of a run."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def _read(folder: Path, status: int, seconds: float) -> PytestOutcome:
    file = folder / "lines"
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []
    begun = [line["begin"] for line in lines if "begin" in line]
    ended = [line for line in lines if "end" in line]
    failed = next((line["end"] for line in ended if line["outcome"] == "failed"), None)
    how = "" if failed is None else "failed"
    if any("prepare" in line for line in lines) or not lines:
        how = "prepare"
    elif len(begun) > len(ended):
        failed = begun[-1]
        by_limit = os.WIFSIGNALED(status) and os.WTERMSIG(status) in _LIMITS
        how = "timeout" if by_limit else "died"
    complete = how != "prepare" and not any("stopped" in line for line in lines)
    return PytestOutcome(lines=tuple(lines), failed=failed, how=how, complete=complete, seconds=seconds)
