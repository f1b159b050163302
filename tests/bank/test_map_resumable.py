"""Jobs on processes of this machine: results, failures of every kind, and going on after a kill -9."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

from groundstation.bank import program_version
from groundstation.bank.dispatcher import FailureKind
from groundstation.bank.map_resumable import MapOutcome, map_resumable
from groundstation.bank.program_version import function_digest, identity_of, program_digest
from groundstation.bank.result_store import JobResult, ResultStore, write_atomically
from groundstation.compilation import Compiling, compilation_watched
from groundstation.errors import InputError, MissingExtraError
from tests.bank import compiling_jobs, fake_jobs

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="extra cluster is not installed")

LIMIT_S = 1.5
NUMBERS = range(12)
# a coordinator of its own, that a test can kill
_COORDINATOR = """
import sys
from pathlib import Path
from groundstation.bank.map_resumable import map_resumable
from tests.bank.fake_jobs import slow_square
if __name__ == "__main__":
    marks, out = sys.argv[1:]
    map_resumable(slow_square, {f"n{k}": (k, marks) for k in range(12)}, Path(out), 2)
"""


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> tuple[MapOutcome, Path, list[int]]:
    """An outcome with jobs of all kinds, its folder, and the reported progress."""
    folder = tmp_path_factory.mktemp("mixed")
    once = f"killed once:{folder / 'mark'}"
    items = {"a": "a", "raises": "raise", "crashes": "crash", "hangs": "hang", "odd": "unreadable", "once": once}
    counts: list[int] = []
    before = dict(os.environ)
    found = map_resumable(
        fake_jobs.misbehave, items, folder / "out", 2, limit_s=LIMIT_S, progress=lambda done, total: counts.append(done)
    )
    # Dask sets variables of its workers here, MALLOC_TRIM_THRESHOLD_ among them
    assert dict(os.environ) == before
    return found, folder / "out", counts


def test_each_job_ends_as_what_it_is(mixed: tuple[MapOutcome, Path, list[int]]) -> None:
    """Expected: a raise, a crash of three workers and a hang are failures with their place; a death is tried again."""
    found, _, counts = mixed
    assert [r.name for r in found.results] == ["a", "once"]
    failures = {f.name: f for f in found.failures}
    assert {name: f.kind for name, f in failures.items()} == {
        "raises": FailureKind.RAISED,
        "crashes": FailureKind.DIED,
        "hangs": FailureKind.TIMED_OUT,
        "odd": FailureKind.RAISED,
    }
    assert failures["raises"].reason.startswith("ValueError: no such runway (bank/fake_jobs.py:")
    assert "3 times (Fatal Python error: Segmentation fault" in failures["crashes"].reason
    assert "string_at" in failures["crashes"].reason
    assert failures["hangs"].reason.startswith("took longer than 1.5 s")
    assert "in hang" in failures["hangs"].reason
    assert "not JSON serializable" in failures["odd"].reason
    assert counts == list(range(7))


def test_only_what_finished_is_kept(mixed: tuple[MapOutcome, Path, list[int]]) -> None:
    _, out, _ = mixed
    assert sorted(p.name.partition("-")[0] for p in out.glob("*.json")) == ["a", "once"]
    assert not list((out / "traces").iterdir())
    assert not list(out.glob(".*"))


def test_a_killed_coordinator_loses_nothing_that_was_finished(tmp_path: Path) -> None:
    """Expected: after kill -9 its workers end, and the next run computes only what had not been finished."""
    marks, out = tmp_path / "marks", tmp_path / "out"
    marks.mkdir()
    script = tmp_path / "coordinator.py"
    script.write_text(_COORDINATOR)
    process = subprocess.Popen([sys.executable, script, marks, out], env=os.environ | {"PYTHONPATH": _root()})
    try:
        wait_until(lambda: len(list(out.glob("n*.json"))) >= 3)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    # not a draft, .PID.part.NAME, that the kill left
    finished = {p.name.partition("-")[0] for p in out.glob("n*.json")}
    assert len(finished) < len(NUMBERS)
    begun = {int(line) for path in marks.iterdir() for line in path.read_text().split()}
    wait_until(lambda: not any(alive(pid) for pid in begun))
    before = {name: (marks / name[1:]).read_text() for name in finished}
    found = map_resumable(fake_jobs.slow_square, {f"n{k}": (k, str(marks)) for k in NUMBERS}, out, 2)
    assert found.reused == len(finished)
    assert {name: (marks / name[1:]).read_text() for name in finished} == before
    assert [r.value["square"] for r in found.results] == [k * k for k in NUMBERS]


def test_a_finished_run_needs_no_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ResultStore(tmp_path, identity_of(fake_jobs.square, "one"))
    store.write(JobResult(name="n3", value={"square": 9}, elapsed_s=1.0, cpu_s=0.5))
    monkeypatch.setitem(sys.modules, "distributed", None)
    found = map_resumable(fake_jobs.square, {"n3": 3}, tmp_path, settings="one")
    assert (found.reused, found.results[0].value) == (1, {"square": 9})
    with pytest.raises(MissingExtraError, match=r"groundstation\[cluster\]"):
        map_resumable(fake_jobs.square, {"n3": 3}, tmp_path, settings="another")


def test_names_are_of_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^items: got the name '\.\./n'"):
        map_resumable(fake_jobs.square, {"../n": 3}, tmp_path)


def test_no_scheduler_is_an_error_of_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("groundstation.bank.cluster._CONNECT_S", 0.2)
    with pytest.raises(
        InputError, match=r"^--scheduler: got tcp://127.0.0.1:9: .*; wanted a Dask scheduler's address$"
    ):
        map_resumable(fake_jobs.square, {"n": 3}, tmp_path, scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize("content", ["", "{", "[]", '{"format": "groundstation-result/1"}', "[" * 100_000])
def test_a_damaged_result_is_none(tmp_path: Path, content: str) -> None:
    store = ResultStore(tmp_path, "f" * 64)
    store.write(JobResult(name="n", value=1, elapsed_s=1.0, cpu_s=0.5))
    (path,) = tmp_path.iterdir()
    path.write_text(content)
    assert store.find("n") is None


def test_results_of_other_libraries_are_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: after an update of OpenCV the sessions of a bank are run again, not mixed with those before it."""
    before = identity_of(fake_jobs.square, "a")
    assert identity_of(fake_jobs.square, "a") == before
    theirs = program_version.metadata.version
    monkeypatch.setattr(
        program_version.metadata, "version", lambda name: "0" if name.startswith("opencv") else theirs(name)
    )
    assert identity_of(fake_jobs.square, "a") != before


def test_results_of_other_settings_are_not_read(tmp_path: Path) -> None:
    ResultStore(tmp_path, "f" * 64).write(JobResult(name="n", value=1, elapsed_s=1.0, cpu_s=0.5))
    assert ResultStore(tmp_path, "f" * 12 + "0" * 52).find("n") is None
    assert identity_of(fake_jobs.square, "a") != identity_of(fake_jobs.square, "b")
    assert identity_of(fake_jobs.square, "a") != identity_of(fake_jobs.misbehave, "a")
    assert function_digest(fake_jobs.square).startswith("square+")
    assert len(program_digest().partition("+")[2]) == 64


def test_a_file_that_cannot_be_written_whole_is_not_there(tmp_path: Path) -> None:
    def fail(path: Path) -> None:
        path.write_text("half")
        raise OSError("no space left")

    with pytest.raises(OSError, match="no space"):
        write_atomically(tmp_path / "table", fail)
    assert list(tmp_path.iterdir()) == []


def wait_until(reached: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 120.0
    while not reached():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def _root() -> str:
    return str(Path(__file__).resolve().parents[2])


def test_what_a_worker_compiles_is_told_to_the_display(tmp_path: Path) -> None:
    """Expected: the kernels of one worker, once; the other compiles the same."""
    told: list[Compiling] = []
    with compilation_watched(told.append):
        found = map_resumable(compiling_jobs.compile_two, {"one": 1, "two": 2}, tmp_path, 2)
    assert len(found.results) == 2
    assert [(what.kernel, what.number, what.at_most) for what in told] == [
        ("detection.kernel_1", 1, 2),
        ("detection.kernel_2", 2, 2),
    ]


def test_a_file_in_place_of_the_results_folder_is_one_line(tmp_path: Path) -> None:
    """Expected: told before a worker starts."""
    (tmp_path / "out").write_text("mine")
    with pytest.raises(InputError, match=r"out/traces: got Not a directory; wanted a folder that can be written"):
        map_resumable(fake_jobs.misbehave, {"a": "a"}, tmp_path / "out", 1)
    assert (tmp_path / "out").read_text() == "mine"
