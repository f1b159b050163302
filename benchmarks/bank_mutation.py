"""Does the bank see a detector that was made worse by hand? The same worlds with every fifth detection withheld.

    python benchmarks/bank_mutation.py [--sessions N] [--duration S] [--workers N] [--out DIR]

The program is copied, one line of the copy is changed so that every fifth detection is reported as a miss, and the copy
draws, renders, replays and scores the first N worlds of the validate set; so does the program. Printed are the pooled
figures of both with their 95 % intervals, and the difference of each pair of sessions with its own interval. Exit code
1 if the hits of the worse detector are inside the interval of the program's.

DIR keeps both banks, so that a stopped run goes on; a finished bank of the program (`groundstation bank
benchmarks/bank/validate.toml --out DIR/program`) with as many or more sessions is taken as it is.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pyarrow.parquet as pq

from groundstation.bank.bank_page import interval_text, share_text
from groundstation.bank.pooled_figures import HIT, WRONG, PooledFigure, Ratio, bootstrap_interval, pooled
from groundstation.bank.program_version import PACKAGES
from groundstation.bank.result_table import Row

ROOT = Path(__file__).resolve().parents[1]
DETECTOR = "groundstation/detection/learned_detector.py"
LINE = "        return self._described(candidate, window, maps, span)\n"
WITHHELD = (
    '        self._count = getattr(self, "_count", 0) + 1\n'
    "        if self._count % 5 == 0:\n"
    '            return Miss(reason=MissReason.LOW_CONTRAST, detail="withheld by hand")\n'
)


def made_worse(folder: Path) -> Path:
    """Copy the program with every fifth detection withheld; returns the copy's folder."""
    shutil.rmtree(folder, ignore_errors=True)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package)
    detector = folder / DETECTOR
    source = detector.read_text(encoding="utf-8")
    if source.count(LINE) != 1:
        raise SystemExit(f"{DETECTOR}: got {source.count(LINE)} times {LINE.strip()!r}, wanted once")
    detector.write_text(source.replace(LINE, WITHHELD + LINE), encoding="utf-8")
    return folder


def bank_of(program: Path, out: Path, options: argparse.Namespace) -> list[Row]:
    """Run a program's bank in a process of its own, or go on with it; returns its rows."""
    settings = out.parent / "bank.toml"
    settings.write_text(
        f'format = "groundstation-bank/1"\nworld_set = "validate"\nsessions = {options.sessions}\n'
        f"duration_s = {options.duration}\nworst = 0\n"
    )
    command = [sys.executable, "-m", "groundstation", "bank", str(settings), "--out", str(out)]
    environment = os.environ | {"PYTHONPATH": str(program)}
    command += ["--workers", str(options.workers)]
    subprocess.run(command, cwd=program, env=environment, check=True, stdout=subprocess.DEVNULL)
    return rows_of(out)


def rows_of(out: Path) -> list[Row]:
    return pq.read_table(out / "rows.parquet").to_pylist()


def finished(out: Path, options: argparse.Namespace) -> list[Row] | None:
    """Return the first rows of a finished bank of enough sessions of the same duration, or None."""
    summary = out / "bank.json"
    if not summary.is_file():
        return None
    settings = json.loads(summary.read_text(encoding="utf-8"))["settings"]
    same = settings["world_set"] == "validate" and settings["first"] == 0
    if not same or settings["duration_s"] != options.duration or settings["sessions"] < options.sessions:
        return None
    return rows_of(out)[: options.sessions]


def difference(ours: Sequence[Row], worse: Sequence[Row], ratio: Ratio) -> tuple[float, float, float]:
    """Return worse less ours of a ratio over the same sessions, with its 95 % interval."""

    def of(rows: Sequence[Row], drawn: Sequence[int]) -> float:
        above = sum(float(rows[k][ratio.above] or 0.0) for k in drawn)
        return above / sum(float(rows[k][ratio.below] or 0.0) for k in drawn)

    everything = range(len(ours))
    low, high = bootstrap_interval(len(ours), lambda drawn: of(worse, drawn) - of(ours, drawn))
    return of(worse, everything) - of(ours, everything), low, high


def text_of(figure: PooledFigure) -> str:
    return f"{share_text(figure.value)} ({interval_text(figure.low, figure.high)})"


def main() -> int:
    """Run both banks and print what differs; 1 where the bank does not see the fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--duration", type=float, default=10.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bank-mutation")
    options = parser.parse_args()
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    ours = finished(out / "program", options) or bank_of(ROOT, out / "program", options)
    worse = bank_of(made_worse(out / "copy"), out / "worse", options)
    if [row["seed"] for row in ours] != [row["seed"] for row in worse]:
        raise SystemExit("bank: a session failed in one of the two, and their worlds are not the same")
    for ratio in (HIT, WRONG):
        change, low, high = difference(ours, worse, ratio)
        print(
            f"{ratio.title}: {text_of(pooled(ours, ratio))}, worse detector {text_of(pooled(worse, ratio))};", end=" "
        )
        print(f"difference {100 * change:+.1f} points ({100 * low:+.1f} … {100 * high:+.1f})")
    before, after = pooled(ours, HIT).low, pooled(worse, HIT).value
    return 0 if before is not None and after is not None and after < before else 1


if __name__ == "__main__":
    raise SystemExit(main())
