"""A small rig, events of all kinds, and the content of a recording of them."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from groundstation.box import Box
from groundstation.files.text_file import AttachedFiles
from groundstation.messages import (
    CameraReport,
    DetectionStatus,
    Epoch,
    Event,
    Frame,
    Miss,
    MissReason,
    PtuSample,
    ReferenceFix,
    StepReport,
    TrackEstimate,
    TrackEvent,
    TrackStatus,
    TriangulationStatus,
)
from groundstation.picture import BayerPattern, Picture, RawPicture
from groundstation.recording.mcap_metadata import RecordingHeader
from groundstation.rig.rig import Rig, load_rig
from groundstation.session import load_session
from groundstation.sources.recording_source import RecordingSource
from tests.session.folder import SESSION, SIZE, rig_text

STATIONS = ("left", "right")
FILES = {"session.toml": SESSION.encode(), "rig.toml": rig_text(STATIONS).encode(), "config.toml": b""}
WINDOW = Box(10, 8, 30, 28)


def small_rig() -> Rig:
    return load_rig(AttachedFiles("test", FILES) / "rig.toml")


def header() -> RecordingHeader:
    return RecordingHeader(name="tiny", files=FILES)


def events(pairs: int, rng: np.random.Generator) -> Iterator[Event]:
    """Readings, noisy raw frames, epochs, and now and then a reference position."""
    for k in range(pairs):
        t_s = 100.0 + k / 30.0
        for name in STATIONS:
            pan, tilt = rng.normal(size=2)
            yield PtuSample(t_s=t_s - 1e-3, station=name, pan_rad=float(pan), tilt_rad=float(tilt))
            raw = rng.integers(0, 256, (SIZE[1], SIZE[0]), dtype=np.uint8)
            yield Frame(t_s=t_s, station=name, epoch=k, image=RawPicture(raw, BayerPattern.RG))
        yield Epoch(t_s=t_s, epoch=k, stations=STATIONS)
        if k % 7 == 3:
            yield ReferenceFix(t_s=t_s, position_runway_m=rng.normal(size=3), sigma_m=np.ones(3))


def looked_at(event: Event) -> StepReport:
    """What a pipeline that reads one window of each frame, and all of every tenth pair's, might answer."""
    if isinstance(event, Frame):
        if event.epoch % 10 == 0:
            event.image.whole()
        event.image.window(WINDOW)
        return StepReport(cameras=(report(event),))
    if isinstance(event, Epoch):
        estimate = TrackEstimate(
            t_s=event.t_s,
            epoch=event.epoch,
            status=TrackStatus.SEARCHING,
            kinematics=None,
            triangulation_status=TriangulationStatus.ONE_VIEW,
            triangulation=None,
            latency_s=0.01,
        )
        reported = TrackEvent(t_s=event.t_s, level="warning", text=f"pair {event.epoch}")
        return StepReport(estimates=(estimate,), events=(reported,))
    return StepReport()


def report(frame: Frame) -> CameraReport:
    return CameraReport(
        t_s=frame.t_s,
        station=frame.station,
        epoch=frame.epoch,
        status=DetectionStatus.MISS,
        result=Miss(reason=MissReason.NO_REGION),
        roi=None,
        predicted_px=None,
        predicted_covariance_px2=None,
        pan_rad=0.1,
        tilt_rad=0.2,
        innovation=None,
        elapsed_s=0.0,
    )


def played(path: Path) -> tuple[list[Event], RecordingSource]:
    """The events of a recording, and the source that gave them."""
    session = load_session(path)
    assert session.recorded is not None
    with RecordingSource(session, session.recorded) as source:
        return list(source), source


def same_pixels(one: Picture, other: Picture, windows: Sequence[tuple[int, int, int, int]]) -> bool:
    return all(np.array_equal(one.window(w)[0], other.window(w)[0]) for w in windows)


def same(one: Event, other: Event) -> bool:
    """Whether two events are the same to the last bit; pixels as far as `looked_at` reads them."""
    if isinstance(one, Frame) and isinstance(other, Frame):
        heads = (one.t_s, one.station, one.epoch, one.image.size_px, one.image.pattern)
        if heads != (other.t_s, other.station, other.epoch, other.image.size_px, other.image.pattern):
            return False
        whole = one.epoch % 10 != 0 or np.array_equal(one.image.whole(), other.image.whole())
        return whole and same_pixels(one.image, other.image, [WINDOW])
    if isinstance(one, ReferenceFix) and isinstance(other, ReferenceFix):
        arrays = np.array_equal(one.position_runway_m, other.position_runway_m)
        return arrays and one.t_s == other.t_s and np.array_equal(one.sigma_m, other.sigma_m)
    return one == other
