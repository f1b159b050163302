"""The copy of the bundled landing that tests replay from 20 s on has the landing's own pictures, to the last bit."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import groundstation
from tests.conftest import ROOT
from tests.seekable_landing import FIRST_S, lossless_copy


def test_its_events_are_those_of_the_landing(landing_1: Path, landing_from_20_s: Path) -> None:
    ends = {"from_s": FIRST_S, "to_s": FIRST_S + 0.55}
    events = [list(groundstation.session_events(session, **ends)) for session in (landing_1, landing_from_20_s)]
    assert len(events[0]) == len(events[1])
    pictures = 0
    for one, two in zip(*events, strict=True):
        assert type(one) is type(two)
        assert one.t_s == two.t_s
        if isinstance(one, groundstation.Frame) and isinstance(two, groundstation.Frame):
            assert one.station == two.station
            np.testing.assert_array_equal(one.image.whole(), two.image.whole())
            pictures += 1
    assert pictures == 10


def test_a_copy_of_a_whole_flight_has_its_pictures(shared_data: Path) -> None:
    """Expected: of the take-off, whose copy others replay; its first pictures."""
    session = shared_data / "takeoff-1"
    copy = lossless_copy(session, ROOT / "build" / "seekable")
    for station in ("left", "right"):
        coded, plain = cv2.VideoCapture(str(session / f"{station}.mp4")), cv2.VideoCapture(str(copy / f"{station}.avi"))
        assert coded.get(cv2.CAP_PROP_FRAME_COUNT) == plain.get(cv2.CAP_PROP_FRAME_COUNT) > 200
        for _ in range(25):
            (one, picture), (other, again) = coded.read(), plain.read()
            assert one
            assert other
            np.testing.assert_array_equal(picture, again)
    assert (copy / "frames.csv").read_bytes() == (session / "frames.csv").read_bytes()


def test_what_is_no_picture_of_the_landing_is_seen_as_none(landing_from_20_s: Path) -> None:
    """Expected: before 20 s there is no track from it, so that no test can use that part unknowingly."""
    run = groundstation.replay_session(landing_from_20_s, to_s=2.0)
    assert not run.tracking.any()
    assert len(run.t_s) > 10


@pytest.mark.parametrize("name", ["frames.csv", "ptu.csv", "truth.csv", "dgps.csv", "rig.toml", "session.toml"])
def test_its_other_files_are_the_landings(name: str, landing_1: Path, landing_from_20_s: Path) -> None:
    assert (landing_from_20_s / name).read_bytes() == (landing_1 / name).read_bytes()
