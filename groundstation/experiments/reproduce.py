"""Run the experiments and write their results: a page, a CSV file per table, a PNG file per figure."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from groundstation.detection.config import DetectorKind
from groundstation.errors import InputError, os_words
from groundstation.evaluation.summary import versions
from groundstation.experiments.experiment import Experiment, Findings
from groundstation.experiments.html_report import paper_page
from groundstation.experiments.registry import EXPERIMENTS, named
from groundstation.experiments.truth_session import TruthSession
from groundstation.files.output_names import below
from groundstation.files.whole_file import write_whole
from groundstation.tracking.warm_up import warm_up

BUNDLED = Path(__file__).resolve().parents[2] / "recordings" / "landing-1"
_PAGE = "reproduce.html"
_SHOWN_VERSIONS = ("groundstation", "numpy", "scipy", "opencv-python-headless")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReproduceRequest:
    """Options of the user; ``only`` empty runs all, ``session`` None uses the bundled landing.

    ``take_off`` is a rendered take-off for the experiment that needs one; None simulates its pixels.
    """

    out: Path
    only: tuple[str, ...] = ()
    session: Path | None = None
    from_s: float | None = None
    to_s: float | None = None
    take_off: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduced:
    """The results: the experiments with their findings and their wall time in s, and the files written."""

    found: tuple[tuple[Experiment, Findings], ...]
    elapsed_s: tuple[float, ...]
    files: tuple[Path, ...]


def reproduce(request: ReproduceRequest, say: Callable[[str], None] = lambda words: None) -> Reproduced:
    """Run the experiments and write page, tables and figures; ``say`` receives the progress messages.

    Raises `InputError` where the session cannot be used, or a file cannot be written.
    """
    chosen = [named(name) for name in dict.fromkeys(request.only)] or list(EXPERIMENTS)
    folder = request.session or BUNDLED
    if request.session is None and not folder.is_dir():
        raise InputError(str(folder), got="no bundled recording", wanted="one, or --session")
    take_off = None if request.take_off is None else TruthSession(request.take_off, say=say)
    recorded = TruthSession(folder, request.from_s, request.to_s, say, take_off=take_off)
    _make(request.out)
    page = request.out / _PAGE
    if page.is_dir():
        # checked before minutes of work
        raise InputError(str(page), got="a folder", wanted="a file that can be written")
    warm_up(DetectorKind.CLASSIC)
    found, elapsed, files = [], [], []
    for experiment in chosen:
        say(experiment.title)
        began = time.perf_counter()
        findings = experiment.run(recorded)
        with _writable(request.out):
            files += _write(request.out, findings)
        found.append((experiment, findings))
        elapsed.append(time.perf_counter() - began)
    title = f"The papers' experiments on {recorded.session.name}"
    with _writable(page):
        write_whole(page, paper_page(title, found, request.out, _notes(request)))
    return Reproduced(found=tuple(found), elapsed_s=tuple(elapsed), files=(page, *files))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(str(folder), got=os_words(fault), wanted="a folder that can be written") from fault


@contextlib.contextmanager
def _writable(path: Path) -> Iterator[None]:
    """Convert an operating system error into an `InputError` that names the file if known."""
    try:
        yield
    except OSError as fault:
        where = Path(fault.filename or path)
        got = "a folder" if where.is_dir() and where != path else os_words(fault)
        raise InputError(str(where), got=got, wanted="a file that can be written") from fault


def _write(folder: Path, findings: Findings) -> list[Path]:
    """Write the tables as CSV and the figures as PNG; returns the files."""
    files = []
    for table in findings.tables:
        table.write_csv(folder)
        files.append(below(folder, f"{table.name}.csv"))
    for figure in findings.figures:
        files.append(below(folder, f"{figure.name}.png"))
        figure.draw(files[-1])
    return files


def _notes(request: ReproduceRequest) -> Sequence[str]:
    """Return notes on the evaluated part and the versions."""
    notes = []
    if request.from_s is not None or request.to_s is not None:
        limits = [f"{word} {v:g} s" for word, v in (("from", request.from_s), ("to", request.to_s)) if v is not None]
        notes.append(f"Only a part of the recording: {' '.join(limits)}.")
    if request.take_off is not None:
        notes.append(f"The take-off is the whole of {request.take_off.name}.")
    known = versions()
    return [*notes, "Versions: " + ", ".join(f"{name} {known[name]}" for name in _SHOWN_VERSIONS) + "."]
