"""Interrupt commands at random moments and check what they say and leave (docs/troubleshooting.md).

    python benchmarks/interrupts.py --out DIR [--count N] [--seed S] [--only WORD …]

Each command runs a few times to its end first, which gives the span over which its interrupts are spread: from the
start of Python to the end of the process. An interrupt goes to the whole process group, as from a terminal. Checked:

- exit code 130, or that of the finished command;
- no traceback, no warning and no other word of a library about it, and no end by force;
- each file under a final name is read by its reader, and no draft is left;
- what the last line says is written is there, and what is there is said; a folder of nothing is not left.

An interrupt within Python's own start, before the first line of the program, is out of its reach; those are counted.
"""

import argparse
import contextlib
import csv
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

ROOT = Path(__file__).resolve().parents[1]
_RUN = "import sys; from groundstation.cli.start import main; sys.exit(main())"
# a command that does not answer its interrupt is lost
_WITHIN_S = 60.0
# a frame of a traceback in the program's own files; the name alone is in that of an editable install's finder
_OWN_LINE = re.compile(r'File "[^"]*/groundstation/[\w/]+\.py"|^groundstation: ', re.MULTILINE)
# Python's warnings, also those of the processes that a library starts
_WARNING = re.compile(r"^\S+:\d+: \w*Warning: |resource_tracker", re.MULTILINE)
# also those moments after the fastest end that was seen, since a machine's speed varies
_BEYOND = 1.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One command to interrupt: its words, what it writes below its own folder, and the exit codes of its end."""

    name: str
    words: Callable[[Path], list[str]]
    ends: frozenset[int] = frozenset({0})


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How a process ended; ``late_s`` is the time from the interrupt to the end."""

    code: int
    out: str
    err: str
    late_s: float


def commands(inputs: Path) -> tuple[Command, ...]:
    """Return the commands; ``inputs`` is the folder in which their inputs were made."""
    landing = str(ROOT / "recordings" / "landing-1")
    video = str(next((ROOT / "recordings" / "landing-1").glob("left.*")))
    return (
        Command(
            name="replay",
            words=lambda out: ["replay", landing, "--out", str(out / "run"), "--from", "20", "--to", "22"],
        ),
        Command(
            name="record",
            words=lambda out: [
                *("replay", landing, "--out", str(out / "run"), "--from", "20", "--to", "21", "--no-rerun"),
                *("--record", str(out / "run.mcap")),
            ],
        ),
        Command(name="simulate", words=lambda out: ["simulate", "--out", str(out / "flight"), "--duration", "1"]),
        # an interrupt is how a flight ends: what it reports then is a result; 1 is one without a track
        Command(
            name="live",
            words=lambda out: ["live", "--simulate", "--for", "3", "--out", str(out / "flight")],
            ends=frozenset({0, 1}),
        ),
        Command(
            name="calibrate",
            words=lambda out: [
                *("calibrate", "mount", str(inputs / "sightings.csv"), "--landmarks", str(inputs / "landmarks.csv")),
                *("--rig", str(inputs / "rig.toml"), "--out", str(out / "better.toml"), "--report", str(out / "page")),
            ],
        ),
        Command(
            name="track",
            words=lambda out: [
                *("track", video, "--out", str(out / "track.csv"), "--from-frame", "200", "--to-frame", "215"),
                *("--save-video", str(out / "seen.mp4")),
            ],
        ),
    )


def run(words: Sequence[str], after_s: float | None) -> Ended:
    """Run a command and interrupt it after a time; None lets it come to its end."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-c", _RUN, *words],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    sent_s = time.monotonic()
    try:
        with contextlib.suppress(subprocess.TimeoutExpired):
            if after_s is not None:
                process.wait(after_s)
        if after_s is not None:
            sent_s = time.monotonic()
            # it may have ended just now
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=_WITHIN_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        out, err = process.communicate()
        err += "\n(did not end)"
    return Ended(code=process.returncode, out=out, err=err, late_s=time.monotonic() - sent_s)


def before_the_program(ended: Ended) -> bool:
    """Return whether Python itself was interrupted: it had not come to a line of the program."""
    own = _OWN_LINE.search(ended.err) is not None or bool(ended.out)
    return not own and ended.code in (1, -signal.SIGINT) and ("KeyboardInterrupt" in ended.err or not ended.err)


def faults_of(command: Command, ended: Ended, out: Path) -> Iterator[str]:
    """Yield what is wrong with an interrupted command."""
    if ended.code not in {130, *command.ends}:
        yield f"exit code {ended.code}"
    if "Traceback" in ended.err or "Exception ignored" in ended.err or "(did not end)" in ended.err:
        yield "a traceback, or no end"
    if _WARNING.search(ended.err):
        yield "a warning"
    if "ended by force" in ended.err:
        yield "ended by force"
    files = [path for path in out.rglob("*") if path.is_file()]
    yield from (f"a draft is left: {path.name}" for path in files if ".part" in path.name or ".partial" in path.name)
    for path in files:
        try:
            read(path)
        except Exception as fault:  # noqa: BLE001 - whatever a reader raises is the finding
            yield f"{path.name} cannot be read: {fault!r}"
    for line in ended.out.splitlines():
        if line.startswith("wrote ") and not Path(line.removeprefix("wrote ")).exists():
            yield f"it says {line!r}, and there is nothing"
    last = ended.err.strip().splitlines()[-1:] if ended.code == 130 else []
    if ended.code == 130 and not (last and last[0].startswith("groundstation: interrupted")):
        yield f"no last line about the interrupt: {last}"
    target = Path(last[0].rpartition("nothing was written to ")[2]) if last else out
    if last and "nothing was written to" in last[0] and target.exists() and any(_files(target)):
        yield f"it says that nothing was written, and there is {target.name}"
    elif last and "nothing was written to" in last[0] and target.is_dir():
        yield f"a folder of nothing is left: {target.name}"
    held = (
        last[0].partition("interrupted; ")[2].partition(" holds what")[0] if last and " holds what" in last[0] else ""
    )
    if held and not any(_files(Path(held))):
        yield f"it says that {held} holds something, and there is nothing"


def _files(path: Path) -> list[Path]:
    return [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]


def read(path: Path) -> None:
    """Read a file to its end as its reader does; raises where it is not whole."""
    text = "" if path.suffix in _BINARY else path.read_text(encoding="utf-8")
    if path.suffix in _BINARY:
        _BINARY[path.suffix](path)
    elif path.suffix in (".csv", ".tum"):
        if text and not text.endswith("\n"):
            raise ValueError("half a line")
        rows = list(csv.reader(text.splitlines(), delimiter="," if path.suffix == ".csv" else " "))
        if len({len(row) for row in rows}) > 1:
            raise ValueError("rows of different lengths")
    elif path.suffix == ".json":
        json.loads(text)
    elif path.suffix == ".toml":
        tomllib.loads(text)
    elif path.suffix in (".html", ".svg"):
        if not text.rstrip().endswith(("</html>", "</svg>")):
            raise ValueError("half a page")
    else:
        raise ValueError("a file without a reader")


def _read_video(path: Path) -> None:
    video = cv2.VideoCapture(str(path))
    if not video.isOpened() or not video.read()[0]:
        raise ValueError("no frame")


def _read_picture(path: Path) -> None:
    if cv2.imread(str(path)) is None:
        raise ValueError("no picture")


def _read_rrd(path: Path) -> None:
    from groundstation.viewer.recording_check import check_recording

    check_recording(path)


def _read_mcap(path: Path) -> None:
    """Read what a recording holds: one that was cut short is a recording to its last whole chunk (`recover`)."""
    out = path.with_name("recovered.mcap")
    out.unlink(missing_ok=True)
    done = run(["recover", str(path), "--out", str(out)], None)
    out.unlink(missing_ok=True)
    if done.code != 0 and path.stat().st_size > 0 and "nothing" not in done.err:
        raise ValueError(done.err.strip())


def _read_arrays(path: Path) -> None:
    import numpy as np

    with np.load(path) as arrays:
        for name in arrays:
            arrays[name]


_BINARY: dict[str, Callable[[Path], None]] = {
    ".avi": _read_video,
    ".mp4": _read_video,
    ".png": _read_picture,
    ".rrd": _read_rrd,
    ".mcap": _read_mcap,
    ".npz": _read_arrays,
}


def make_inputs(folder: Path) -> None:
    """Make the sightings of one camera on its head that `calibrate mount` reads."""
    sys.path.insert(0, str(ROOT))
    from tests.docs.inputs import prepare

    prepare(folder, "mount")


def interrupt_one(command: Command, after_s: float, out: Path) -> tuple[str, list[str], float]:
    """Interrupt one run; returns the kind of its end, its faults, and how long it took to end, s."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    ended = run(command.words(out), after_s)
    if before_the_program(ended):
        return "in Python's own start", [], ended.late_s
    faults = list(faults_of(command, ended, out))
    if faults:
        (out / "stderr.txt").write_text(ended.err, encoding="utf-8")
        print(f"  {command.name} after {after_s:.3f} s: {'; '.join(faults)}\n{ended.err[-1500:]}", flush=True)
    return ("interrupted" if ended.code == 130 else f"ended with {ended.code}"), faults, ended.late_s


def main() -> int:
    """Interrupt all commands; returns 1 if something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="a scratch folder")
    parser.add_argument("--count", type=int, default=500, help="interrupts of all commands together (default: 500)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=[], help="names of commands")
    options = parser.parse_args()
    # a shell starts a job in the background with interrupts ignored, which its children would inherit
    signal.signal(signal.SIGINT, signal.default_int_handler)
    inputs = options.out / "inputs"
    shutil.rmtree(inputs, ignore_errors=True)
    inputs.mkdir(parents=True)
    make_inputs(inputs)
    chosen = [c for c in commands(inputs / "mount") if not options.only or c.name in options.only]
    generator = random.Random(options.seed)
    wrong = 0
    for number, command in enumerate(chosen):
        lengths = []
        for _ in range(2):
            scratch = options.out / "whole"
            shutil.rmtree(scratch, ignore_errors=True)
            scratch.mkdir(parents=True)
            whole = run(command.words(scratch), None)
            if whole.code not in command.ends:
                raise SystemExit(f"{command.name} ends with {whole.code}: {whole.err}")
            lengths.append(whole.late_s)
        count = options.count // len(chosen) + (number < options.count % len(chosen))
        kinds: Counter[str] = Counter()
        slowest_s = 0.0
        for k in range(count):
            # one in each part of the span: start and end are never left out
            after_s = (k + generator.random()) / count * min(lengths) * _BEYOND
            kind, faults, late_s = interrupt_one(command, after_s, options.out / "one")
            kinds[kind] += 1
            slowest_s = max(slowest_s, late_s)
            wrong += bool(faults)
        found = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
        print(f"{command.name}: {count} in {min(lengths):.1f} s: {found}; ended within {slowest_s:.1f} s", flush=True)
    print(f"wrong: {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
