"""Fixtures that all tests share: where the data is, and seeded randomness."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from groundstation.cli.start import ONE_THREAD
from groundstation.tracking.llvm_lock import drop_lock_events

# as the program begins, before numpy is there; OpenCV's threads, too, would only take the cores from the other workers,
# in the programs that tests start as well, and its operations then take up to 40 % more of a processor
os.environ.update(ONE_THREAD | {"OPENCV_FOR_THREADS_NUM": "1"} | os.environ)

import numpy as np
import pytest
from hypothesis import settings

from tests.compile_once import compile_once
from tests.kept_memory import keep_freed_memory
from tests.seekable_landing import lossless_copy, seekable_landing

ROOT = Path(__file__).resolve().parent.parent

# `make test` draws the same examples every time; `make fuzz` draws new ones and remembers what failed
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("new", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile("same")
# Dask's workers are forked from one process that has its modules, which take half a second of a core each; as started
# by users they are in tests/bank/test_parallel_study.py
DASK_START = "DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD"
os.environ.setdefault(DASK_START, "forkserver")
compile_once()
drop_lock_events()
keep_freed_memory()
# a hundred thousand objects are alive once all tests are collected, and each full collection walks through all of them:
# 30 % of the time of tests that build syntax trees (tests/architecture, 27.9 to 19.1 s)
gc.set_threshold(100_000, 50, 50)

# The files that take longest start first: a worker takes whole files, and all others would wait for one started last.
LONGEST_FILES = (
    "replay/test_rendered_sessions.py",
    "sources/cameras/test_gige_fakes.py",
    "experiments/test_reproduce.py",
    "docs/test_commands.py",
    "calibration/stars/test_stars_command.py",
    "live/test_head_process_lost.py",
    "ptu_drivers/test_rfc2217.py",
    "live/test_operation.py",
    "api/test_examples.py",
    "training/test_windows.py",
    "live/test_interrupted.py",
    "live/test_ending_bound.py",
    "calibration/stars/test_night_fit.py",
    "hostile/test_bombs.py",
    "estimation/test_against_bounds.py",
    "calibration/flight/test_real_flight.py",
    "onboard/edges/test_nose_approaches.py",
    "evaluation/test_reference_edits.py",
    "onboard/test_fly_command.py",
    "calibration/mount/test_mount.py",
    "cli/test_ptu.py",
    "calibration/landmarks/test_sightings_command.py",
    "ptu_drivers/alpaca/test_alpaca_independent.py",
    "live/test_check_command.py",
    "cli/test_main.py",
    "docs/test_printed.py",
    "test_seekable_landing.py",
    "estimation/test_leaving_the_image.py",
    "estimation/test_smoother.py",
    "evaluation/test_comparison_page.py",
    "live/test_words.py",
    "detection/test_birds.py",
    "pointing/test_keep_out_pointing.py",
    "evaluation/test_evaluate.py",
    "tracking/test_warm_up.py",
    "evaluation/test_zoom_plot.py",
    "replay/test_late_data.py",
    "detection/test_learned_finder.py",
    "calibration/clocks/test_timing.py",
    "mutants/test_list.py",
    "replay/test_input_checks.py",
    "approach/test_approach_replay.py",
    "ptu_drivers/test_lifecycle.py",
    "onboard/visual_inertial/test_nose_flight.py",
    "viewer/test_comparison_recording.py",
    "mutants/test_run.py",
    "single_camera/test_pixel_tracker.py",
    "bank/test_map_resumable.py",
    "evaluation/test_report_page.py",
    "live/test_keep_out_zones.py",
    "docs/test_site.py",
    "onboard/edges/test_tracker.py",
    "replay/test_learned_replay.py",
    "simulation/drawn_stations/test_drawn_stations.py",
    "integrity/test_station_exclusion.py",
    "calibration/stars/test_check_by_stars.py",
    "replay/test_full_disk.py",
    "detection/test_chan_vese.py",
    "live/test_heads.py",
    "sources/test_picture_reader.py",
    "cli/test_ptu_other_protocols.py",
    "integrity/test_gnss_watch.py",
    "simulation/world/test_worlds.py",
    "replay/test_recording_identity.py",
    "replay/test_learning.py",
    "calibration/flight/test_lasting_error.py",
    "single_camera/test_target_review.py",
    "simulation/test_closed_loop.py",
    "cli/test_interrupts.py",
    "calibration/flight/test_flight.py",
)


# The files of these folders are given to one worker: what they share is made once, such as the syntax trees of all
# modules, which take four seconds of a core.
TOGETHER = ("tests/architecture/",)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give workers whole files, as ``--dist=loadfile``, and those of `TOGETHER` as if they were one."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class WholeFiles(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return next((folder for folder in TOGETHER if nodeid.startswith(folder)), super()._split_scope(nodeid))

    return WholeFiles(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; all others keep their order (``--no-loadscope-reorder`` keeps it among workers)."""
    ranks = {ROOT / "tests" / name: rank for rank, name in enumerate(LONGEST_FILES)}
    for file in ranks:
        assert file.is_file(), f"tests/conftest.py lists {file} among the longest, and there is no such file"
    items.sort(key=lambda item: ranks.get(item.path, len(ranks)))


def pytest_collection_finish() -> None:
    """Leave out of every later collection of garbage what stays until the end: the tests, and the modules they need."""
    gc.collect()
    gc.freeze()


def _shared_data() -> Path:
    return Path(os.environ.get("GROUNDSTATION_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of independent recordings, which are not part of the project."""
    folder = _shared_data()
    if not folder.is_dir():
        pytest.skip(f"independent recordings not found at {folder}; set GROUNDSTATION_DATA")
    return folder


@pytest.fixture(scope="session")
def landing_1() -> Path:
    """The bundled stereo landing."""
    return ROOT / "recordings" / "landing-1"


@pytest.fixture(scope="session")
def landing_from_20_s(landing_1: Path) -> Path:
    """The bundled landing for tests that use it from 20 s on, and not its videos' own coding."""
    return seekable_landing(landing_1, ROOT / "build" / "seekable")


@pytest.fixture(scope="session")
def lossless_landing(landing_1: Path) -> Path:
    """The bundled landing for tests that use much of it, and not its videos' own coding."""
    return lossless_copy(landing_1, ROOT / "build" / "seekable")


@pytest.fixture(scope="session")
def classic_tuning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tuning with the classic detector, which searches a picture in a fifth of the time.

    For tests in which it does not matter by what the aircraft is found.
    """
    path = tmp_path_factory.mktemp("tuning") / "classic.toml"
    path.write_text('[detection]\ndetector = "classic"\n', encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def unrendered_figures() -> Iterator[None]:
    """A replay builds its report's figures, and Matplotlib does not render them, which takes longer than the replay.

    For tests of a replay's other outputs; tests/evaluation and tests/cli use rendered figures.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("groundstation.evaluation.figure_style.render", lambda figure: ("<svg></svg>", b""))
        yield


@pytest.fixture(scope="module")
def unrendered_pictures() -> Iterator[None]:
    """A calibration builds its report's figures, and Matplotlib does not render them: a tenth of a second each.

    For tests of a calibration's other outputs; those of flight, clocks and landmarks, and the pages' own commands, use
    rendered ones.
    """

    from matplotlib.figure import Figure

    class Unrendered(Figure):
        def savefig(self, fname: BinaryIO, **_: object) -> None:
            fname.write(b"\x89PNG\r\n\x1a\n")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calibration.report.drawing.Figure", Unrendered)
        yield


@pytest.fixture(autouse=True)
def not_ended_by_force(monkeypatch: pytest.MonkeyPatch) -> None:
    """A station that runs in the tests' own process may end late on a busy machine, and must not end the tests with it.

    Its bound is tested on programs of their own (`tests/live/test_ending_bound.py`).
    """
    monkeypatch.setattr("groundstation.cli.live.end_by_force", print)


@pytest.fixture
def unhurried_shutdown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A station in the tests' own process may take its time to end; its bounds are tested elsewhere."""
    monkeypatch.setattr("groundstation.live.shutdown.END_S", 60.0)
    monkeypatch.setattr("groundstation.live.command.CLOSE_S", 30.0)


@pytest.fixture
def interrupts_heard() -> Iterator[None]:
    """Let the tests' child processes hear interrupts, which a shell's background job ignores."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator seeded by the test's own name: the same draw in each run, another in each test."""
    return np.random.default_rng(list(request.node.name.encode()))
