"""Is the stated covariance that of the errors? Each replay again with true pixels plus the noise that is stated.

    python benchmarks/true_pixels.py [--first N] [--worlds N] [--keep DIR] [--session DIR ...] [--wrong SHARE]
        [--workers N]

N worlds of the validate set, 10 s at 10 Hz, or the session folders, are replayed as they are, and again with the true
pixel of the nose in place of each detected one, displaced by a draw of the stated covariance, of which the share that
the filter takes to last lasts. That run states no error of the detected point (`target_point_sigma_spans`), as it has
none. SHARE of its pixels is gross: anywhere within `GROSS_PX` of the true one.

Printed are both runs' figures and quantiles of the sessions' ANEES, with the probability of a difference as large as
theirs if both were of one distribution (two-sample Kolmogorov-Smirnov test). DIR keeps rendered worlds, also those of
`groundstation bank --worlds DIR`.
"""

import argparse
import contextlib
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from parallel_study import STUDIES, StudyRun, add_study_arguments
from scipy.stats import ks_2samp

from groundstation.arrays import FloatArray
from groundstation.bank.frame_outcomes import frame_outcomes
from groundstation.bank.rendered_worlds import rendered_world
from groundstation.bank.result_table import Row
from groundstation.bank.session_figures import session_figures
from groundstation.bank.session_truth import SessionTruth
from groundstation.estimation.state_model import CORRELATED_SHARE, CORRELATION_TIME_S
from groundstation.messages import Detection, Frame
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_session, load_truth
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from groundstation.tracking import frame_update
from groundstation.tracking.camera_tracker import CameraTracker
from groundstation.tracking.weighed_pixel import weighed

DURATION_S, FRAME_HZ = 10.0, 10.0
# as far as a window of the detector reaches around an aircraft of some 40 px
GROSS_PX = 100.0
DETECTED, TRUE, GROSS = "as detected", "true pixels", "true pixels, some gross"
TUNING = """[estimation]
target_point_sigma_spans = [0.0, 0.0, 0.0]
target_point_behind_spans = 0.0
target_point_behind_up_spans = 0.0
"""
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


@contextlib.contextmanager
def true_pixels(folder: Path, noise: StatedNoise) -> Iterator[None]:
    """Replay a session of ``folder`` in the block with true pixels plus ``noise``; what is not detected stays so."""
    truth = load_truth(load_session(folder))
    assert truth is not None, f"{folder} has no truth.csv"
    detect = CameraTracker.detect
    looked_at: list[tuple[str, Frame]] = []

    def detect_in(self: CameraTracker, frame: Frame, *arguments: Any) -> Any:
        looked_at[:] = [(self.station.name, frame)]
        return detect(self, frame, *arguments)

    def true_pixel(*arguments: Any) -> Detection:
        found = weighed(*arguments)
        station, frame = looked_at[0]
        if not truth.visible[station][frame.epoch]:
            return found
        u, v = truth.pixels_px[station][frame.epoch] + noise.draw(station, frame.t_s, found.covariance_px2)
        return replace(found, u_px=float(u), v_px=float(v), hypotheses=())

    with mock.patch.object(CameraTracker, "detect", detect_in), mock.patch.object(frame_update, "weighed", true_pixel):
        yield


def scored(item: dict[str, Any]) -> Row:
    """Return the figures of a world or a session folder: as detected, or with true pixels."""
    if item["seed"] is None:
        folder = Path(item["session"])
    else:
        world = draw_world(item["seed"], duration_s=DURATION_S, frame_hz=FRAME_HZ)
        folder = rendered_world(world, Path(item["keep"]))
    with tempfile.TemporaryDirectory(prefix="groundstation-true-pixels-") as name, contextlib.ExitStack() as block:
        config = None
        if item["run"] != DETECTED:
            config = Path(name) / "tuning.toml"
            config.write_text(TUNING, encoding="utf-8")
            noise = StatedNoise(item["seed"] or 0, item["wrong"] if item["run"] == GROSS else 0.0)
            block.enter_context(true_pixels(folder, noise))
        result = replay(ReplayRequest(session=folder, out=Path(name) / "out", config=config, rerun=False, report=False))
    truth = SessionTruth(load_session(folder))
    return session_figures(truth, result.evaluation, frame_outcomes(truth, result.evaluation)).to_row()


def line(name: str, rows: Sequence[Row]) -> str:
    """Return a run's row of the first table."""
    misleading = f"{_sum(rows, 'misleading_epochs'):.0f} of {_sum(rows, 'tracking_epochs'):.0f}"
    anees = _sum(rows, "nees_sum") / (3.0 * _sum(rows, "nees_count"))
    nis = _sum(rows, "nis_sum") / _sum(rows, "nis_dof")
    errors = "/".join(f"{np.median(_values(rows, f'rmse_{axis}_m')):.3f}" for axis in "xyz")
    return f"| {name} | {len(rows)} | {misleading} | {anees:.2f} | {nis:.2f} | {errors} |"


def quantiles(name: str, rows: Sequence[Row]) -> str:
    """Return a run's row of the second table."""
    values = np.quantile(anees_of(rows), QUANTILES)
    return f"| {name} | " + " | ".join(f"{value:.2f}" for value in values) + " |"


def anees_of(rows: Sequence[Row]) -> list[float]:
    """Return each session's ANEES while tracking."""
    return [float(r["nees_sum"]) / (3.0 * float(r["nees_count"])) for r in rows if r["nees_count"]]


def ratios(rows: Sequence[Row], others: Sequence[Row]) -> str:
    """Return the medians of the sessions' RMSE over those of another run, x/y/z."""
    found = []
    for column in (f"rmse_{axis}_m" for axis in "xyz"):
        pairs = zip(rows, others, strict=True)
        found.append(np.median([float(a[column]) / float(b[column]) for a, b in pairs if a[column] and b[column]]))
    return "/".join(f"{ratio:.2f}" for ratio in found)


def _values(rows: Sequence[Row], column: str) -> list[float]:
    return [float(row[column]) for row in rows if row[column] is not None]


def _sum(rows: Sequence[Row], column: str) -> float:
    return sum(_values(rows, column))


def main() -> int:
    """Replay all sessions in each way, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=53)
    parser.add_argument("--keep", type=Path, default=STUDIES / "worlds")
    parser.add_argument("--session", type=Path, action="append", metavar="DIR")
    parser.add_argument("--wrong", type=float, default=0.0, metavar="SHARE")
    add_study_arguments(parser, "true-pixels")
    options = parser.parse_args()
    if not 0.0 <= options.wrong < 1.0:
        parser.error(f"--wrong: got {options.wrong:g}, wanted a share from 0 to below 1")
    keep = str(options.keep.resolve())
    sessions: dict[str, dict[str, Any]] = {
        folder.name: {"seed": None, "session": str(folder.resolve())} for folder in options.session or ()
    }
    if not sessions:
        seeds = [seed_of(WorldSet.VALIDATE, k) for k in range(options.first, options.first + options.worlds)]
        sessions = {str(seed): {"seed": seed, "keep": keep} for seed in seeds}
    runs = [DETECTED, TRUE, *([GROSS] if options.wrong else [])]
    items = {
        f"{name}-{run}": {**each, "run": run, "wrong": options.wrong} for name, each in sessions.items() for run in runs
    }
    rows = StudyRun.chosen("true pixels", options).values(scored, items)
    of_run = {run: [rows[f"{name}-{run}"] for name in sessions] for run in runs}
    print("| pixels | sessions | misleading | ANEES | NIS | RMSE x/y/z, m, median |\n|---|---|---|---|---|---|")
    for run in runs:
        print(line(run, of_run[run]))
    print("\n| ANEES of a session | " + " | ".join(f"{100 * q:.0f} %" for q in QUANTILES) + " |")
    print("|---" * (1 + len(QUANTILES)) + "|")
    for run in runs:
        print(quantiles(run, of_run[run]))
    if GROSS in of_run:
        print(f"\nRMSE x/y/z with gross pixels over that without, median: {ratios(of_run[GROSS], of_run[TRUE])}")
    test = ks_2samp(anees_of(of_run[DETECTED]), anees_of(of_run[TRUE]))
    print(f"\n{DETECTED} against {TRUE}: D = {test.statistic:.2f}, p = {test.pvalue:.2g}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
