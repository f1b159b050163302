"""Does the bank see a detector that was made worse by hand? The same worlds with every fifth detection withheld.

    python benchmarks/bank_mutation.py [--sessions N] [--duration S] [--workers N] [--out DIR] [--sessions-of BANK]

The program is copied, one line of the copy is changed so that every fifth detection is reported as a miss, and both
draw, render, replay and score the first N worlds of the validate set. Printed are the pooled figures of both with their
95 % intervals, and their difference with the interval of a bootstrap over pairs of sessions. Exit code 1 if the hits of
the worse detector are inside the interval of the program's, 2 where it could not be tried.

DIR keeps both banks, so that a stopped run goes on. BANK is the output of another bank, whose finished sessions are
used where they are of this program and of these settings.
"""

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import pyarrow.parquet as pq

from groundstation.bank.bank_page import interval_text, share_text
from groundstation.bank.pooled_figures import HIT, WRONG, PooledFigure, Ratio, bootstrap_interval, pooled
from groundstation.bank.program_version import PACKAGES
from groundstation.bank.result_table import Row

ROOT = Path(__file__).resolve().parents[1]
DETECTOR = "groundstation/detection/learned_detector.py"
LINE = "        return self._described(best, span, hint)\n"
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
        raise untried(f"{DETECTOR}: got {source.count(LINE)} times {LINE.strip()!r}, wanted once")
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
    table = out / "rows.parquet"
    # of an earlier run, of other worlds or of another program
    table.unlink(missing_ok=True)
    # exit code 1 where a session failed, which is then left out of both
    subprocess.run(command, cwd=program, env=environment, check=False, stdout=subprocess.DEVNULL)
    if not table.is_file():
        raise untried(f"{out}: the bank left no rows")
    rows: list[Row] = pq.read_table(table).to_pylist()
    return rows


def untried(reason: str) -> SystemExit:
    print(reason, file=sys.stderr)
    return SystemExit(2)


def copy_sessions(bank: Path, out: Path) -> None:
    """Copy the finished sessions of another bank; those of another program or of other settings are run again."""
    if not (bank / "sessions").is_dir():
        raise untried(f"--sessions-of: got {bank}, wanted the output of a bank")
    if bank.resolve() != out.resolve():
        shutil.copytree(bank / "sessions", out / "sessions", dirs_exist_ok=True)


def difference(ours: Sequence[Row], worse: Sequence[Row], ratio: Ratio) -> tuple[float, float, float]:
    """Return worse less ours of a ratio over the same sessions, with its 95 % interval."""

    def of(rows: Sequence[Row], drawn: Iterable[int]) -> float:
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
    parser.add_argument("--sessions-of", type=Path, metavar="BANK")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bank-mutation")
    options = parser.parse_args()
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if options.sessions_of is not None:
        copy_sessions(options.sessions_of, out / "program")
    ours = {row["seed"]: row for row in bank_of(ROOT, out / "program", options)}
    other = {row["seed"]: row for row in bank_of(made_worse(out / "copy"), out / "worse", options)}
    both = sorted(seed for seed in ours.keys() & other.keys() if ours[seed][HIT.below] and other[seed][HIT.below])
    if len(both) < 2:
        raise untried(f"bank: got {len(both)} sessions that both have scored, wanted 2 or more")
    ours_rows, worse_rows = [ours[seed] for seed in both], [other[seed] for seed in both]
    for ratio in (HIT, WRONG):
        change, low, high = difference(ours_rows, worse_rows, ratio)
        theirs = text_of(pooled(worse_rows, ratio))
        print(f"{ratio.title}: {text_of(pooled(ours_rows, ratio))}, worse detector {theirs};", end=" ")
        print(f"difference {100 * change:+.1f} points ({100 * low:+.1f} … {100 * high:+.1f})")
    before, after = pooled(ours_rows, HIT).low, pooled(worse_rows, HIT).value
    return 0 if before is not None and after is not None and after < before else 1


if __name__ == "__main__":
    raise SystemExit(main())
