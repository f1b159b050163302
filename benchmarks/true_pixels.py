"""Is the stated covariance that of the errors? Each replay again with true pixels plus the noise that is stated.

    python benchmarks/true_pixels.py [--first N] [--worlds N] [--keep DIR] [--detected BANK] [--session DIR ...]
        [--wrong SHARE] [--workers N]

N worlds of the validate set, 10 s at 10 Hz, or session folders with their truth, are replayed as they are, and again
with the true pixel of the nose in place of each detected one, displaced by a draw of the detection's covariance, of
which the share that the filter takes to last lasts. Wrong detections are corrected by that, too; what stays as detected
are the candidates that start a track, the widths and the odds, and pixels of a nose outside of the picture. That run
states no error of the detected point (`target_point_sigma_spans`), as it has none. With --wrong a third run has a SHARE
of gross pixels, each anywhere in a square of ± `GROSS_PX` around the true one.

Printed are the runs' figures, quantiles of the sessions' ANEES, and two tests of the detected pixels' ANEES against the
true ones': the Kolmogorov-Smirnov test of two samples, and Wilcoxon's signed ranks of the logarithms of each session's
ratio, which is the sharper one, as both runs share worlds and calibrations. The true pixels' ANEES is no 1 either: it
says what the filter states too much or too little by itself. DIR keeps rendered worlds, also those of
`groundstation bank --worlds DIR`; BANK is the output of a bank of this program with these worlds, which are then not
replayed as they are.
"""

import argparse
import contextlib
import hashlib
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pyarrow.parquet as pq
from parallel_study import STUDIES, StudyRun, add_study_arguments
from scipy.stats import ks_2samp, wilcoxon

from groundstation.arrays import FloatArray
from groundstation.bank.frame_outcomes import frame_outcomes
from groundstation.bank.rendered_worlds import rendered_world
from groundstation.bank.result_table import Row
from groundstation.bank.session_figures import session_figures
from groundstation.bank.session_truth import SessionTruth
from groundstation.cli.number_arguments import count
from groundstation.errors import SessionError
from groundstation.estimation.state_model import CORRELATED_SHARE, CORRELATION_TIME_S
from groundstation.messages import Detection, Frame
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import Truth, load_session, load_truth
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from groundstation.tracking.frame_update import FrameUpdate

DURATION_S, FRAME_HZ = 10.0, 10.0
# about as far as a window of the detector reaches around an aircraft of 70 px
GROSS_PX = 100.0
DETECTED, TRUE, GROSS = "as detected", "true pixels", "true pixels, some gross"
TUNING = """[estimation]
target_point_sigma_spans = [0.0, 0.0, 0.0]
target_point_behind_lead_spans = 0.0
target_point_behind_spans = 0.0
target_point_behind_up_spans = 0.0
"""
# what makes a frame's detection of a picture and a prediction: there is no public place between it and the filter
DETECT = "_detect"
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


class StatedNoise:
    """Draws pixel errors as the filter takes them to be: one part white, one Gauss-Markov, of each camera its own."""

    def __init__(self, seed: int, gross_share: float) -> None:
        self._rng, self._gross_share = np.random.default_rng(seed), gross_share
        self._lasting: dict[str, tuple[float, FloatArray]] = {}

    def draw(self, station: str, t_s: float, covariance_px2: FloatArray) -> FloatArray:
        """Return the error (2,) of a camera's pixel at ``t_s``, px; ``covariance_px2`` (2, 2) is the stated one."""
        before_s, lasting = self._lasting.get(station, (-math.inf, np.zeros(2)))
        kept = math.exp(-max(t_s - before_s, 0.0) / CORRELATION_TIME_S)
        lasting = kept * lasting + math.sqrt(1.0 - kept * kept) * self._rng.normal(size=2)
        self._lasting[station] = t_s, lasting
        white, gross, far = self._rng.normal(size=2), self._rng.uniform(), self._rng.uniform(-1.0, 1.0, size=2)
        if gross < self._gross_share:
            return np.asarray(GROSS_PX * far)
        in_sigmas = math.sqrt(CORRELATED_SHARE) * lasting + math.sqrt(1.0 - CORRELATED_SHARE) * white
        return np.asarray(np.linalg.cholesky(covariance_px2) @ in_sigmas)


class TruePixels:
    """Puts true pixels plus noise in place of what is detected in a block; counts those replaced, and the others."""

    def __init__(self, truth: Truth, noise: StatedNoise) -> None:
        self._truth, self._noise = truth, noise
        self.replaced = self.as_detected = 0

    @contextlib.contextmanager
    def in_place(self) -> Iterator[None]:
        """Run the block with true pixels, for the filter and for the cameras' agreement among themselves."""
        detect = vars(FrameUpdate)[DETECT]

        def true_pixel(update: FrameUpdate, record: Frame, prediction: Any) -> Any:
            outcome = detect(update, record, prediction)
            if not isinstance(outcome.result, Detection):
                return outcome
            found = self._true(record, outcome.result)
            return outcome._replace(result=found, by_itself=found)

        with mock.patch.object(FrameUpdate, DETECT, true_pixel):
            yield

    def _true(self, record: Frame, found: Detection) -> Detection:
        station, truth = record.station, self._truth
        if station not in truth.visible or not truth.visible[station][record.epoch]:
            self.as_detected += 1
            return found
        self.replaced += 1
        error_px = self._noise.draw(station, record.t_s, found.covariance_px2)
        u, v = truth.pixels_px[station][record.epoch] + error_px
        return replace(found, u_px=float(u), v_px=float(v), hypotheses=())


def truth_of(folder: Path) -> Truth:
    """Return the truth of a session. Raises `SessionError` without it."""
    truth = load_truth(load_session(folder))
    if truth is None:
        raise SessionError(str(folder), got="no truth.csv", wanted="a session with its truth")
    return truth


def scored(item: dict[str, Any]) -> Row:
    """Return the figures of a world or a session folder: as detected, or with true pixels."""
    if item["seed"] is None:
        folder = Path(item["session"])
        seed = int.from_bytes(hashlib.sha256(folder.name.encode()).digest()[:4], "big")
    else:
        seed = item["seed"]
        world = draw_world(seed, duration_s=DURATION_S, frame_hz=FRAME_HZ)
        folder = rendered_world(world, Path(item["keep"]))
    pixels: TruePixels | None = None
    with tempfile.TemporaryDirectory(prefix="groundstation-true-pixels-") as name, contextlib.ExitStack() as block:
        config = None
        if item["run"] != DETECTED:
            config = Path(name) / "tuning.toml"
            config.write_text(TUNING, encoding="utf-8")
            pixels = TruePixels(truth_of(folder), StatedNoise(seed, item.get("wrong", 0.0)))
            block.enter_context(pixels.in_place())
        request = ReplayRequest(session=folder, out=Path(name) / "out", config=config, rerun=False, report=False)
        result = replay(request)
    truth = SessionTruth(load_session(folder))
    row: Row = session_figures(truth, result.evaluation, frame_outcomes(truth, result.evaluation)).to_row()
    return row if pixels is None else {**row, "replaced": pixels.replaced, "left_as_detected": pixels.as_detected}


def line(name: str, rows: Sequence[Row]) -> str:
    """Return a run's row of the first table."""
    misleading = f"{_sum(rows, 'misleading_epochs'):.0f} of {_sum(rows, 'tracking_epochs'):.0f}"
    anees = _sum(rows, "nees_sum") / max(3.0 * _sum(rows, "nees_count"), 1.0)
    nis = _sum(rows, "nis_sum") / max(_sum(rows, "nis_dof"), 1.0)
    errors = "/".join(f"{np.median(_values(rows, f'rmse_{axis}_m') or [np.nan]):.3f}" for axis in "xyz")
    replaced = f"{_sum(rows, 'replaced'):.0f}, {_sum(rows, 'left_as_detected'):.0f}"
    return f"| {name} | {len(rows)} | {replaced} | {misleading} | {anees:.2f} | {nis:.2f} | {errors} |"


def quantiles(name: str, rows: Sequence[Row]) -> str:
    """Return a run's row of the second table."""
    values = np.quantile([each for each in map(anees, rows) if each is not None] or [np.nan], QUANTILES)
    return f"| {name} | " + " | ".join(f"{value:.2f}" for value in values) + " |"


def anees(row: Row) -> float | None:
    """Return a session's ANEES while tracking; None where nothing was tracked."""
    return float(row["nees_sum"]) / (3.0 * float(row["nees_count"])) if row["nees_count"] else None


def compared(detected: Sequence[Row], true: Sequence[Row]) -> str:
    """Return both tests of the ANEES of the same sessions, and the median of their ratios."""
    pairs = [(anees(a), anees(b)) for a, b in zip(detected, true, strict=True)]
    first, second = np.array([(a, b) for a, b in pairs if a and b]).reshape(-1, 2).T
    if first.size < 2:
        return f"no test: {first.size} sessions were tracked in both runs, 2 are the least"
    ks, ranks = ks_2samp(first, second), wilcoxon(np.log(first / second))
    return (
        f"{first.size} sessions: two samples D = {ks.statistic:.2f}, p = {ks.pvalue:.2g}; signed ranks "
        f"p = {ranks.pvalue:.2g}, ratio {np.median(first / second):.2f} in the median"
    )


def ratios(rows: Sequence[Row], others: Sequence[Row]) -> str:
    """Return the medians of the sessions' RMSE over those of another run, x/y/z."""
    found = []
    for column in (f"rmse_{axis}_m" for axis in "xyz"):
        pairs = zip(rows, others, strict=True)
        found.append(np.median([float(a[column]) / float(b[column]) for a, b in pairs if a[column] and b[column]]))
    return "/".join(f"{ratio:.2f}" for ratio in found)


def jobs(options: argparse.Namespace, runs: Sequence[str]) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the jobs of the worlds or of the session folders, by their names and by the run."""
    sessions: dict[str, dict[str, Any]] = {}
    for folder in options.session or ():
        truth_of(folder)
        name = folder.resolve().name
        if name in sessions:
            raise SessionError(str(folder), got=f"a second session named {name}", wanted="different names")
        sessions[name] = {"seed": None, "session": str(folder.resolve())}
    if not sessions:
        keep = str(options.keep.resolve())
        for k in range(options.first, options.first + options.worlds):
            seed = seed_of(WorldSet.VALIDATE, k)
            sessions[str(seed)] = {"seed": seed, "keep": keep}
    share = {GROSS: {"wrong": options.wrong}}
    return {(name, run): {**each, "run": run, **share.get(run, {})} for name, each in sessions.items() for run in runs}


def rows_of(bank: Path, seeds: Sequence[int]) -> list[Row]:
    """Return a bank's rows of these worlds. Raises `SessionError` where it has none of one."""
    table = bank / "rows.parquet"
    rows: dict[int, Row] = {int(r["seed"]): r for r in pq.read_table(table).to_pylist()} if table.is_file() else {}
    if missing := [seed for seed in seeds if seed not in rows]:
        raise SessionError(str(table), got=f"no row of world {missing[0]}", wanted="a bank with all these worlds")
    return [rows[seed] for seed in seeds]


def main() -> int:
    """Replay all sessions in each way, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first world (0)")
    parser.add_argument("--worlds", type=count, default=53, metavar="N", help="how many worlds (53)")
    parser.add_argument("--keep", type=Path, default=STUDIES / "worlds", metavar="DIR", help="where worlds are kept")
    parser.add_argument("--session", type=Path, action="append", metavar="DIR", help="a session instead of worlds")
    parser.add_argument("--wrong", type=float, default=0.0, metavar="SHARE", help="share of gross pixels (0: no run)")
    parser.add_argument("--detected", type=Path, metavar="BANK", help="a bank's output, not to replay as detected")
    add_study_arguments(parser, "true-pixels")
    options = parser.parse_args()
    if not 0.0 <= options.wrong < 1.0:
        parser.error(f"--wrong: got {options.wrong:g}, wanted a share from 0 to below 1")
    if options.first < 0:
        parser.error(f"--first: got {options.first}, wanted 0 or more")
    runs = [DETECTED, TRUE, *([GROSS] if options.wrong else [])]
    try:
        items = jobs(options, runs if options.detected is None else runs[1:])
        seeds = [item["seed"] for (_, run), item in items.items() if run == TRUE]
        known = [] if options.detected is None else rows_of(options.detected, seeds)
    except SessionError as fault:
        parser.error(str(fault))
    values = StudyRun.chosen("true pixels", options).values(
        scored, {f"{name}-{run}": item for (name, run), item in items.items()}
    )
    of_run = {run: [values[f"{name}-{each}"] for name, each in items if each == run] for run in runs}
    of_run[DETECTED] = known or of_run[DETECTED]
    if not _sum(of_run[TRUE], "replaced"):
        print("no pixel was replaced: nothing was detected, or no nose is in a picture")
        return 1
    print("| pixels | sessions | replaced, left as detected | misleading | ANEES | NIS | RMSE x/y/z, m, median |")
    print("|---|---|---|---|---|---|---|")
    for run in runs:
        print(line(run, of_run[run]))
    print("\n| ANEES of a session | " + " | ".join(f"{100 * q:.0f} %" for q in QUANTILES) + " |")
    print("|---" * (1 + len(QUANTILES)) + "|")
    for run in runs:
        print(quantiles(run, of_run[run]))
    if GROSS in of_run:
        print(f"\nRMSE x/y/z with gross pixels over that without, median: {ratios(of_run[GROSS], of_run[TRUE])}")
    print(f"\n{DETECTED} against {TRUE}, {compared(of_run[DETECTED], of_run[TRUE])}")
    return 0


def _values(rows: Sequence[Row], column: str) -> list[float]:
    return [float(row[column]) for row in rows if row.get(column) is not None]


def _sum(rows: Sequence[Row], column: str) -> float:
    return sum(_values(rows, column))


if __name__ == "__main__":
    raise SystemExit(main())
