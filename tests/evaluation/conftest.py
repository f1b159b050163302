"""Runs that several tests use, made once."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.evaluate import track_series, triangulated_series
from groundstation.evaluation.position_series import PositionSeries
from groundstation.messages import DgpsFix
from groundstation.rig.rig import Rig, load_rig
from tests.evaluation.synthetic import Path3D, fixes_of, read_path, run_on


@pytest.fixture(scope="session")
def rig() -> Rig:
    return load_rig(Path(__file__).resolve().parents[2] / "recordings" / "landing-1" / "rig.toml")


@pytest.fixture(scope="session")
def landing_truth() -> Path3D:
    return read_path(Path(__file__).resolve().parents[2] / "recordings" / "landing-1" / "truth.csv")


@pytest.fixture(scope="session")
def landing_run(landing_truth: Path3D, rig: Rig) -> ResultCollector:
    """The bundled landing seen through 0.6 px of noise."""
    return run_on(landing_truth, rig, np.random.default_rng(7))


@pytest.fixture(scope="session")
def landing_track(landing_run: ResultCollector) -> PositionSeries:
    return track_series(landing_run.epochs())


@pytest.fixture(scope="session")
def landing_points(landing_run: ResultCollector) -> PositionSeries:
    return triangulated_series(landing_run.epochs())


@pytest.fixture(scope="session")
def landing_fixes(landing_truth: Path3D) -> list[DgpsFix]:
    """A DGPS log of the bundled landing, 0.3 s late, with 1.5 cm of noise."""
    return fixes_of(landing_truth, 0.3, np.random.default_rng(8))
