"""Frames, readings and pixels in operation that cannot be used: each is counted with its reason, others are used."""

import math
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

from groundstation.detection.candidate_finder import CandidateFinder
from groundstation.live.core import LiveCore, LiveStep, live_config
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.input_queue import Item, TimedPicture
from groundstation.messages import (
    CameraReport,
    Event,
    FilterReset,
    Miss,
    MissReason,
    PixelMeasurement,
    PtuSample,
    ReferenceFix,
    TrackEvent,
)
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

    def take(self, item: Item | PixelMeasurement, now_s: float) -> None:
        self._take(self.core.take(item, now_s))

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


BLACK = BgrPicture(np.zeros((960, 1280, 3), np.uint8))
AT: dict[str, Any] = {"t_s": 0.29, "station": "left"}


@pytest.mark.parametrize(
    ("item", "kind", "line"),
    [
        (
            PtuSample(**AT, pan_rad=math.nan, tilt_rad=math.inf),
            "readings of left, not finite",
            "left: got pan_rad = nan, tilt_rad = inf, wanted finite numbers: the reading is not used",
        ),
        (
            PtuSample(t_s=-math.inf, station="left", pan_rad=0.0, tilt_rad=0.0),
            "readings of left, not finite",
            "left: got t_s = -inf, wanted finite numbers: the reading is not used",
        ),
        (
            TimedPicture(t_s=math.nan, arrived_s=0.3, station="left", picture=BLACK),
            "frames of left, not finite",
            "left: got t_s = nan, wanted finite numbers: the frame is not used",
        ),
        (
            PixelMeasurement(**AT, epoch=0, u_px=math.nan, v_px=3.0, sigma_px=(1.0, math.nan)),
            "pixels of left, not finite",
            "left: got u_px = nan, sigma_px = nan, wanted finite numbers: the pixel is not used",
        ),
        (
            ReferenceFix(t_s=0.29, position_runway_m=np.array([1.0, np.nan, 3.0]), sigma_m=np.ones(3)),
            "positions of DGPS, not finite",
            "DGPS: got y_m = nan, wanted finite numbers: the position is not used",
        ),
    ],
)
def test_a_value_that_is_not_finite_is_refused(
    station: Station, item: Item | PixelMeasurement, kind: str, line: str
) -> None:
    """Expected: the filter is not reset, one line says it and another counts the rest, and pairs go on."""
    station.pairs(3)
    for _ in range(3):
        station.take(item, 0.3)
    station.pairs(3)
    station.finish()
    assert station.core.refused == {kind: 3}
    assert [event.text for event in station.lines if "finite" in event.text] == [
        line,
        f"{line} (2 like it since 0.3 s)",
    ]
    assert len(station.reasons("left")) == len(station.reasons("right")) == 6
    assert all(math.isfinite(event.t_s) for event in station.consumed)


@pytest.mark.parametrize("t_s", [math.nan, math.inf])
def test_a_stamp_that_is_not_finite_does_not_make_pairs_wait(t_s: float) -> None:
    """Expected: a camera whose only stamp is none has never delivered, and pairs are closed without it."""
    pairing = FramePairer(("left", "right"), 1.0 / RATE_HZ)
    pairing.delivered("right", t_s)
    closed = [pairing.frame("left", 1.0 + k / RATE_HZ).closed_after for k in range(12)]
    assert [len(epochs) for epochs in closed[-3:]] == [1, 1, 1]
