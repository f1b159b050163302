"""A camera without pictures is named, whatever the others show."""

import math
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import SessionError
from groundstation.session import load_session
from groundstation.sources.camera_gaps import camera_notes
from groundstation.sources.folder_source import FolderSource
from tests.session.folder import Tiny

ALL = np.arange(0.0, 12.05, 0.1)


def only(from_s: float, to_s: float) -> np.ndarray:
    return np.where((from_s <= ALL) & (to_s >= ALL), ALL, np.nan)


def test_a_camera_without_any_picture_is_named() -> None:
    notes = camera_notes({"left": only(20.0, 30.0), "right": ALL, "third": ALL}, math.inf)
    assert notes == ["left: no picture from 0.0 to 12.0 s, where other stations have some"]


def test_a_camera_that_starts_late_or_is_lost_is_named() -> None:
    notes = camera_notes({"left": only(3.95, 12.0), "right": only(0.0, 7.05), "third": only(1.0, 11.0)}, math.inf)
    assert notes == [
        "left: pictures from 4.0 to 12.0 s only, of 0.0 to 12.0 s",
        "right: pictures from 0.0 to 7.0 s only, of 0.0 to 12.0 s",
    ]


def test_what_was_not_reached_is_not_missed() -> None:
    """Expected: nothing of a camera that is lost after the end of the replay; nothing without any picture."""
    assert camera_notes({"left": only(0.0, 7.05), "right": ALL}, 8.0) == []
    assert camera_notes({"left": ALL, "right": ALL}, -math.inf) == []


def test_a_session_names_a_camera_that_has_filmed_nothing(tmp_path: Path) -> None:
    """Expected: it is read, as `convert` writes a part of a flight that one camera has missed."""
    names, none = ("left", "right", "third"), [None] * 12
    folder = Tiny(names=names, fixed=names, video="png", stamps={"third": none}).write(tmp_path / "session")
    with FolderSource(load_session(folder)) as source:
        frames = [event for event in source if hasattr(event, "image")]
        notes = source.notes(0.25)
    assert len(frames) == 24
    assert notes == ["third: no picture from 1.0 to 2.1 s, where other stations have some"]


def test_a_folder_without_the_pictures_that_are_listed_is_refused(tmp_path: Path) -> None:
    names, last = ("left", "right", "third"), [None] * 11 + [2.1]
    folder = Tiny(names=names, fixed=names, video="png", stamps={"third": last}).write(tmp_path / "session")
    (folder / "third" / "000011.png").unlink()
    with pytest.raises(SessionError, match="third/: got no picture"):
        load_session(folder)
