"""Head angles from the picture in operation: recorded, so that a replay has them without panorama or whole frames."""

import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.panorama.mosaic import PanoramaFrame, make_mosaic
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.errors import ConfigError, InputError
from groundstation.live.check import check_station
from groundstation.live.command import LiveRequest
from groundstation.live.command import live as operate_live
from groundstation.live.core import LiveCore, LiveStep, live_config
from groundstation.live.devices import check_against_rig
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.input_queue import TimedPicture
from groundstation.live.station_file import load_station
from groundstation.messages import CameraReport, Event, FilterReset, Frame, FrameAngles, PtuSample, StepReport
from groundstation.picture import as_picture
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.recording.mcap_metadata import RecordingHeader
from groundstation.recording.recorder import Recorder, RecorderConfig
from groundstation.registration.panorama import GroundPanorama
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.sources.panorama_file import write_panoramas
from groundstation.sources.recording_source import RecordingSource
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.registered_heads import BETWEEN_SEARCHES, RegisteredHeads
from tests.calibration.landmarks.sighting_set_up import true_rig, write_station
from tests.calibration.panorama.test_panorama import NOISE_RAD, frame, mosaic, station
from tests.recording.recorded import FILES
from tests.session.folder import SESSION

RATE_HZ = 30.0
PAIRS = 8
TRUE_DEG = (1.0, -1.5)
# nothing flies here: its search takes a fifth of the time
CLASSIC = Config(detection=DetectionConfig(detector=DetectorKind.CLASSIC))


def rig() -> Rig:
    """Return two stations of the drawn ground, of which one has a panorama."""
    place = station().ptu_position_m + np.array([5.0, 0.0, 0.0])
    whole = replace(station(), ptu_sigma_rad=NOISE_RAD)
    return Rig(stations=(whole, replace(whole, name="other", ptu_position_m=place)))


def core(heads: RegisteredHeads) -> LiveCore:
    one = rig()
    pipeline = Pipeline(one, live_config(CLASSIC, RATE_HZ), heads=heads)
    pattern = SearchPattern({s.name: s.geometry() for s in one.stations}, SearchConfig())
    return LiveCore(pipeline, FramePairer(one.names, 1.0 / RATE_HZ), {}, pattern)


def operate(live: LiveCore, last: int = PAIRS) -> LiveStep:
    """Give a core frames of the ground and readings that are off, and return all that it made of them.

    No reading of the other head follows pair ``last``.
    """
    random, done = np.random.default_rng(21), LiveStep()

    def add(step: LiveStep) -> None:
        done.consumed.extend(step.consumed)
        done.reports.extend(step.reports)

    for k in range(PAIRS):
        t_s = 1.0 + k / RATE_HZ
        for name in rig().names:
            for at_s in (t_s - 0.005, t_s + 0.005)[: 1 if k == last and name == "other" else 2]:
                pan, tilt = np.radians(TRUE_DEG) + random.normal(0.0, 0.7 * NOISE_RAD, 2)
                add(live.take(PtuSample(t_s=at_s, station=name, pan_rad=float(pan), tilt_rad=float(tilt)), at_s))
                if at_s < t_s:
                    grey = frame(*TRUE_DEG, random).astype(np.uint8)
                    image = np.repeat(np.repeat(grey, 2, axis=0), 2, axis=1)
                    picture = as_picture(np.repeat(image[:, :, None], 3, axis=2))
                    add(live.take(TimedPicture(t_s=t_s, station=name, picture=picture, arrived_s=t_s), t_s))
    add(live.finish())
    return done


def cameras(reports: list[StepReport], name: str) -> list[CameraReport]:
    return [camera for report in reports for camera in report.cameras if camera.station == name]


def replayed(events: list[Event]) -> list[StepReport]:
    pipeline = Pipeline(rig(), live_config(CLASSIC, RATE_HZ))
    return [*(pipeline.step(event) for event in events), pipeline.finish()]


def test_a_replay_of_what_was_consumed_has_the_angles_of_the_pictures(tmp_path: Path) -> None:
    """Expected: bit for bit those of the operation, through a recording, without the panorama; the other head's too."""
    name = station().name
    live = operate(core(RegisteredHeads(rig(), {name: mosaic().panorama})))
    found = [event for event in live.consumed if isinstance(event, FrameAngles)]
    assert len(found) == PAIRS
    assert {event.station for event in found} == {name}
    files = {**FILES, "session.toml": SESSION.encode(), "rig.toml": rig_to_toml(rig()).encode()}
    path = tmp_path / "flight.mcap"
    with Recorder(path, rig(), RecordingHeader(name="tiny", files=files), RecorderConfig(png_fill=0.0)) as recorder:
        for event in live.consumed:
            recorder.take(event)
        for report in live.reports:
            recorder.write(report)
    session = load_session(path)
    assert session.recorded is not None
    with RecordingSource(session, session.recorded) as source:
        events = list(source)
    assert [event for event in events if isinstance(event, FrameAngles)] == found
    again = replayed(events)
    for station_name in rig().names:
        own = [(c.t_s, c.pan_rad, c.tilt_rad, c.status) for c in cameras(live.reports, station_name)]
        assert len(own) == PAIRS
        assert own == [(c.t_s, c.pan_rad, c.tilt_rad, c.status) for c in cameras(again, station_name)]
    # a panorama that is given tells the angles of frames that are whole, whatever was recorded
    other = replace(mosaic().panorama, left_rad=mosaic().panorama.left_rad + np.radians(0.1))
    heads = RegisteredHeads(rig(), {name: other})
    for event in live.consumed:
        if isinstance(event, FrameAngles):
            heads.recall(event)
    pipeline = Pipeline(rig(), live_config(CLASSIC, RATE_HZ), heads=heads)
    with_it = [*(pipeline.step(event) for event in live.consumed), pipeline.finish()]
    moved = [c.pan_rad or 0.0 for c in cameras(with_it, name)]
    assert np.degrees(moved) == pytest.approx(TRUE_DEG[0] + 0.1, abs=0.05)
    assert heads.notes() == [f"head angles of {name} from the picture in {PAIRS} of {PAIRS} frames"]
    off = {n: np.degrees([c.pan_rad or 0.0 for c in cameras(live.reports, n)]) - TRUE_DEG[0] for n in rig().names}
    assert np.abs(off[name]).max() < 0.05
    assert np.std(off[name]) < 0.5 * np.std(off["other"])


def test_the_operation_says_how_often_the_pictures_told() -> None:
    live = operate(core(RegisteredHeads(rig(), {station().name: mosaic().panorama})))
    said = [event.text for report in live.reports for event in report.events]
    assert f"head angles of {station().name} from the picture in {PAIRS} of {PAIRS} frames" in said
    # without a panorama there is nothing to say
    plain = operate(core(RegisteredHeads(rig(), {})))
    assert not any("head angles" in event.text for report in plain.reports for event in report.events)
    assert not any(isinstance(event, FrameAngles) for event in plain.consumed)


def test_a_filter_that_fails_at_the_end_leaves_angles_before_its_reset_and_notes_in_time() -> None:
    """Expected: what the last frames' pictures told is recorded before the reset; notes come after it, not at zero."""
    live = core(RegisteredHeads(rig(), {station().name: mosaic().panorama}))
    finish = live.pipeline.finish

    def failing() -> StepReport:
        finish()
        raise ArithmeticError("made up")

    live.pipeline.finish = failing  # type: ignore[method-assign]
    # the last pair waits for a reading of the other head: its angles are taken in the end only
    done = operate(live, PAIRS - 1)
    kinds = [type(event) for event in done.consumed]
    assert kinds[-2:] == [FrameAngles, FilterReset]
    (notes,) = ([e for e in report.events if "head angles" in e.text] for report in done.reports[-1:])
    assert [note.t_s for note in notes] == pytest.approx([1.0 + (PAIRS - 1) / RATE_HZ], abs=0.02)


def test_a_search_is_not_made_for_each_frame() -> None:
    """Expected: an encoder of half a degree wants a search: of eight frames one, the others counted."""
    poor = Rig(stations=tuple(replace(s, ptu_sigma_rad=np.radians(0.5)) for s in rig().stations))
    heads = RegisteredHeads(poor, {station().name: mosaic().panorama}, search_every=8)
    operate(core(heads))
    (note,) = heads.notes()
    assert f"from the picture in 1 of {PAIRS} frames; {PAIRS - 1} the encoder's: {BETWEEN_SEARCHES}" in note


def test_registration_does_not_make_a_recording_keep_whole_frames() -> None:
    read: list[bool] = []
    heads = RegisteredHeads(rig(), {station().name: mosaic().panorama})
    improve = heads.improve

    def watched(ready, fuse, rates):  # type: ignore[no-untyped-def]
        better = improve(ready, fuse, rates)
        if isinstance(ready.record, Frame):
            read.append(ready.record.image.whole_read)
        return better

    heads.improve = watched  # type: ignore[method-assign]
    operate(core(heads))
    assert read == [False] * (2 * PAIRS)


def with_panorama(folder: Path) -> Path:
    """Return a station file of two heads, left and right, that names a panorama p.npz, which is not there yet."""
    path = write_station(folder, true_rig())
    path.write_text(path.read_text().replace('rig = "rig.toml"\n', 'rig = "rig.toml"\npanorama = "p.npz"\n'))
    return path


def drawn_panorama() -> GroundPanorama:
    return make_mosaic(
        station(),
        [
            PanoramaFrame(grey=frame(pan, -1.5, np.random.default_rng(1)), angles_rad=np.radians([pan, -1.5]))
            for pan in (0.0, 0.5, 1.0)
        ],
        np.radians(3.0),
    ).panorama


def test_a_station_file_names_a_panorama(tmp_path: Path) -> None:
    assert load_station(write_station(tmp_path, true_rig())).panorama is None
    file = load_station(with_panorama(tmp_path))
    rig_of_file = file.load_rig()
    with pytest.raises(ConfigError, match=r"field\.toml: panorama: got .*p\.npz .*wanted a file"):
        file.registered_heads(rig_of_file)
    (tmp_path / "p.npz").write_bytes(b"no panorama")
    wrong = r"field\.toml: panorama: .*p\.npz: got .*; wanted .*calibrate panorama"
    with pytest.raises(InputError, match=wrong):
        file.registered_heads(rig_of_file)
    write_panoramas(tmp_path / "p.npz", {"left": drawn_panorama()})
    assert file.registered_heads(rig_of_file).names == ("left",)
    check_against_rig(file, rig_of_file)


@pytest.mark.parametrize("content", [None, b"no panorama", {"third": ...}])
def test_a_panorama_that_cannot_be_used_stops_only_what_uses_it(tmp_path: Path, content: Any) -> None:
    """Expected: `live` names file and key before a device is opened; `check` has one failed line; others do not ask."""
    path = with_panorama(tmp_path)
    if isinstance(content, bytes):
        (tmp_path / "p.npz").write_bytes(content)
    elif content is not None:
        write_panoramas(tmp_path / "p.npz", {name: drawn_panorama() for name in content})
    said = r"field\.toml: panorama: .*p\.npz"
    request = LiveRequest(station=path, out=tmp_path / "out", seconds=1.0)
    with pytest.raises(ConfigError, match=said):
        operate_live(request, stop=lambda: False, tell=lambda _: None, say=lambda _: None)
    assert not (tmp_path / "out").exists()
    file = load_station(path)
    rig_of_file = file.load_rig()
    check_against_rig(file, rig_of_file)
    lines = list(islice(check_station(path, 0.1, move=False), 3))
    assert [line.good for line in lines] == [True, lines[1].good, False]
    assert re.search(said, lines[2].text)
