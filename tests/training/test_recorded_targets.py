"""Targets of recordings with true silhouettes: each with the labels of its own frame."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

from groundstation.bank.session_truth import SessionTruth
from groundstation.session import load_session, load_truth
from groundstation.sources.video_file import VideoFile
from training.recorded_windows import labelled_picture, recorded_targets, target_in

FIRST, PAIRS = 7, 12


def _rows(source: Path, target: Path, dropped: tuple[str, ...] = ()) -> None:
    """Copy the rows of the part of a table, without columns whose name ends with any of ``dropped``."""
    with source.open(newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    kept = [k for k, name in enumerate(header) if not dropped or not name.endswith(dropped)]
    with target.open("w", newline="", encoding="utf-8") as stream:
        table = [header, *rows[FIRST : FIRST + PAIRS]]
        csv.writer(stream).writerows([row[k] for k in kept] for row in table)


@pytest.fixture
def part(shared_data: Path, tmp_path: Path) -> Path:
    """A session whose pairs begin with a later frame of its videos."""
    for name in ("session.toml", "rig.toml", "masks.npz", "left.mp4", "right.mp4", "ptu.csv"):
        shutil.copy(shared_data / "landing-1" / name, tmp_path / name)
    for name in ("frames.csv", "truth.csv"):
        _rows(shared_data / "landing-1" / name, tmp_path / name)
    return tmp_path


def test_a_recording_that_begins_later_in_its_videos_has_its_own_frames_labels(part: Path) -> None:
    """Expected: the picture, silhouette and nose of frame 7 for the first pair, not the picture of frame 0."""
    session = load_session(part)
    truth, exact = SessionTruth(session), load_truth(session)
    assert exact is not None
    found = recorded_targets(part)
    assert len(found) == 2 * PAIRS / 3
    (frame,) = VideoFile(part / "left.mp4").frames(FIRST, FIRST)
    seen = truth.frame("left", 0)
    assert seen is not None
    silhouette = seen.silhouette
    picture = labelled_picture(frame.image, silhouette)
    wanted = target_in(picture, silhouette.centre_px, float(silhouette.width_px), exact.pixels_px["left"][0])
    np.testing.assert_array_equal(found[0].image, wanted.image)
    np.testing.assert_array_equal(found[0].cover, wanted.cover)
    np.testing.assert_allclose(found[0].nose_px, wanted.nose_px)


def test_a_truth_without_pixels_leaves_the_noses_unknown(part: Path, shared_data: Path) -> None:
    _rows(shared_data / "landing-1" / "truth.csv", part / "truth.csv", ("_u_px", "_v_px"))
    found = recorded_targets(part)
    assert len(found) == 2 * PAIRS / 3
    assert all(np.isnan(target.nose_px).all() for target in found)
