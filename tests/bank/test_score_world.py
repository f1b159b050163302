"""One job of the bank from seed to row: a small world is rendered, replayed and scored, with a stand-in for CSRT."""

import base64
import stat
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from groundstation.bank import score_world
from groundstation.bank.contact_sheet import TILES
from groundstation.bank.csrt_process import require_csrt
from groundstation.bank.frame_classes import FRAME_FACTORS, class_column
from groundstation.bank.score_world import WorldJob
from groundstation.errors import InputError
from groundstation.simulation.drawn_cameras import CameraSpec
from groundstation.simulation.picture_writer import PictureFormat
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import World

SEED = 3
# answers as `csrt_worker` does, each time with the box that it was started in
TRACKER = f"""#!{sys.executable}
import sys
while line := sys.stdin.buffer.readline().split():
    if line[0] != b"next":
        width, height, *box = (float(v) for v in line)
    sys.stdin.buffer.read(3 * int(width) * int(height))
    print(*([0] if line[0] != b"next" else [0, *box]), flush=True)
"""


def small_world(seed: int, *, duration_s: float, frame_hz: float) -> World:
    """A drawn world with two stations and small pictures without loss."""
    world = draw_world(seed, duration_s=duration_s, frame_hz=frame_hz)
    camera = CameraSpec(image_size_px=(320, 240), focal_px=1200.0, coding=PictureFormat.PNG)
    stations = replace(world.stations, stations=world.stations.stations[:2])
    return replace(world, stations=stations, cameras=(camera,) * 2)


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    tracker = tmp_path_factory.mktemp("tracker") / "python"
    tracker.write_text(TRACKER)
    tracker.chmod(tracker.stat().st_mode | stat.S_IXUSR)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(score_world, "draw_world", small_world)
        worlds = tmp_path_factory.mktemp("worlds")
        job = WorldJob(seed=SEED, duration_s=3.0, frame_hz=5.0, csrt_python=str(tracker), worlds=str(worlds))
        found = score_world.score_world(job)
        assert len(list(worlds.iterdir())) == 1
        return found | {"kept": score_world.score_world(replace(job, csrt_python=None))["row"]}


def test_a_row_has_factors_figures_and_the_baseline(scored: dict[str, Any]) -> None:
    row = scored["row"]
    assert row["seed"] == SEED
    assert row["factor picture"] == "320 x 240"
    assert 0 < row["visible_frames"] <= row["frames"] <= 32
    assert row["hit"] + row["wrong_visible"] <= row["visible_frames"]
    # a box that does not move contains the aircraft at first and not at the end, or always: its share is above 0
    assert 0.0 < row["baseline_hit_share"] <= 1.0
    assert 0.0 < row["baseline_coverage"] <= 1.0
    assert all(value is None or np.isfinite(value) for value in row.values() if not isinstance(value, str))


def test_a_kept_world_gives_the_same_figures(scored: dict[str, Any]) -> None:
    row = {name: value for name, value in scored["row"].items() if not name.startswith("baseline")}
    assert scored["kept"] == row


def test_classes_of_frames_add_up_to_the_visible_frames(scored: dict[str, Any]) -> None:
    row = scored["row"]
    for factor in FRAME_FACTORS:
        for what, total in (("visible", "visible_frames"), ("hit", "hit"), ("wrong", "wrong_visible")):
            assert sum(row[class_column(factor, kind, what)] for kind in factor.classes) == row[total]


def test_the_sheet_shows_frames_side_by_side(scored: dict[str, Any]) -> None:
    sheet = cv2.imdecode(np.frombuffer(base64.b64decode(scored["sheet"]), np.uint8), cv2.IMREAD_COLOR)
    assert sheet is not None
    assert sheet.shape == (240, TILES * 320, 3)


@pytest.mark.parametrize("python", ["none", sys.executable])
def test_a_python_without_csrt_is_named_before_the_first_session(python: str, tmp_path: Path) -> None:
    """Expected: neither a missing program nor one with OpenCV 5, which has no CSRT."""
    with pytest.raises(InputError, match="opencv-contrib-python-headless below 5"):
        require_csrt(tmp_path / python)
