"""Frames in operation that cannot be looked at: each is a counted miss with its reason, and operation goes on."""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from groundstation.detection.candidate_finder import CandidateFinder
from groundstation.live.core import LiveCore, LiveStep, live_config
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.input_queue import TimedPicture
from groundstation.messages import CameraReport, Event, FilterReset, Miss, MissReason, PtuSample, TrackEvent
from groundstation.picture import BgrPicture
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.stereo_rig import make_rig

RATE_HZ = 10.0
SIZE = (1280, 960)


class Station:
    """A core that is fed with readings of heads at rest and with pictures, pair by pair."""

    def __init__(self) -> None:
        rig = make_rig()
        geometries = {s.name: s.geometry() for s in rig.stations}
        pipeline = Pipeline(rig, live_config(Config(), RATE_HZ))
        pairing = FramePairer(rig.names, 1.0 / RATE_HZ)
        self.core = LiveCore(pipeline, pairing, {}, SearchPattern(geometries, SearchConfig()))
        self.consumed: list[Event] = []
        self.cameras: list[CameraReport] = []
        self.lines: list[TrackEvent] = []
        self._pair = 0

    def pairs(self, count: int, size_px: tuple[int, int] = SIZE) -> None:
        """Feed pairs; those of ``left`` are of a size (w, h)."""
        for _ in range(count):
            t_s = self._pair / RATE_HZ
            for name in self.core.pipeline._rig.names:
                for reading_s in (t_s - 0.02, t_s + 0.02):
                    reading = PtuSample(t_s=reading_s, station=name, pan_rad=0.0, tilt_rad=1e-4 * reading_s)
                    self._take(self.core.take(reading, t_s + 0.03))
            for name, (w, h) in (("left", size_px), ("right", SIZE)):
                picture = BgrPicture(np.full((h, w, 3), 120, np.uint8))
                shown = TimedPicture(t_s=t_s, arrived_s=t_s, station=name, picture=picture)
                self._take(self.core.take(shown, t_s + 0.03))
            self._pair += 1

    def finish(self) -> None:
        self._take(self.core.finish())

    def reasons(self, name: str) -> list[MissReason]:
        return [c.result.reason for c in self.cameras if c.station == name and isinstance(c.result, Miss)]

    def _take(self, step: LiveStep) -> None:
        self.consumed += step.consumed
        for report in step.reports:
            self.cameras += report.cameras
            self.lines += report.events


@pytest.fixture
def station() -> Iterator[Station]:
    made = Station()
    yield made
    assert not [event for event in made.consumed if isinstance(event, FilterReset)]


def test_a_frame_in_which_opencv_fails_is_a_miss(station: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a line names the fault, the rest of it is counted, and the next frames are searched."""
    real = CandidateFinder.find
    failing = True

    def find(finder: CandidateFinder, *args: Any) -> Any:
        if failing:
            cv2.cvtColor(np.empty((0, 0, 3), np.uint8), cv2.COLOR_BGR2GRAY)
        return real(finder, *args)

    monkeypatch.setattr(CandidateFinder, "find", find)
    station.pairs(3)
    failing = False
    station.pairs(3)
    station.finish()
    for name in ("left", "right"):
        assert station.reasons(name) == [MissReason.DETECTION_FAILED] * 3 + [MissReason.NOT_ACQUIRED] * 3
    lines = [line.text for line in station.lines if "detection failed" in line.text]
    assert len(lines) == 4
    assert lines[0] == (
        "left: the detection failed: (-215:Assertion failed) !_src.empty() in function 'cvtColor'; the frame is a miss"
    )


@pytest.mark.parametrize("size_px", [(640, 480), (1920, 1440)])
def test_a_picture_of_another_size_is_a_miss(station: Station, size_px: tuple[int, int]) -> None:
    """Expected: as where a camera was opened again with its default size; a line at each change, the other sees on."""
    station.pairs(3)
    station.pairs(12, size_px)
    station.pairs(3)
    station.finish()
    searched = [MissReason.NOT_ACQUIRED] * 3
    assert station.reasons("left") == [*searched, *([MissReason.OTHER_PICTURE_SIZE] * 12), *searched]
    assert station.reasons("right") == [MissReason.NOT_ACQUIRED] * 18
    lines = [(line.t_s, line.text) for line in station.lines if "pictures" in line.text]
    w, h = size_px
    assert lines == [
        (0.3, f"left: got pictures of {w} × {h} px, wanted 1280 × 960 as in the rig"),
        (1.5, "left: pictures are of 1280 × 960 px again, as in the rig"),
    ]
