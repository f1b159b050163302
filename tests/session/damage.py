"""A small session with every file that it may have, how each is read, and a recording whose messages are damaged."""

import itertools
import random
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from groundstation.conversion.angle_table import read_angle_table
from groundstation.conversion.import_clock import ImportClock
from groundstation.conversion.video_stamps import read_video_stamps
from groundstation.errors import InputError, RecordingError, SessionError
from groundstation.evaluation.comparison_text import format_comparison
from groundstation.messages import Event, Frame
from groundstation.picture import PictureError
from groundstation.recording.mcap_reader import McapReader
from groundstation.recording.recorder import PATIENT, Recorder
from groundstation.recording.recovery import recover
from groundstation.replay.compare import CompareRequest, compare, comparison_csv, comparison_json
from groundstation.rig.rig import load_rig
from groundstation.session import Session, load_dgps, load_session, load_truth
from groundstation.session.logs.gps_time import gps_from_text
from groundstation.sources.external_detections import read_detections
from groundstation.sources.frame_table import read_frames
from groundstation.sources.ptu_readings import PtuReadings
from groundstation.sources.session_source import session_source
from groundstation.sources.true_silhouettes import SilhouetteArchive
from groundstation.sources.video_file import VideoFile
from groundstation.sources.visibility_table import read_visibility
from groundstation.tracking.config import load_config
from groundstation.viewer.media import VideoAsset, load_video
from tests.recording.recorded import WINDOW, events, header, looked_at, small_rig
from tests.session.folder import Tiny, write_video
from tests.session.logs.damage import altered, damaged

_SESSION = """name = "tiny"
[origin]
lat_deg = 35.68
lon_deg = 139.76
height_m = 60
y_axis_azimuth_deg = 12.5
[clocks]
left = { offset_s = 61.95, sigma_s = 0.3 }
[target]
span_m = 2.0
antenna_in_body_m = [-0.4, 0.0, -0.1]
[initial]
t_s = 1.0
position_m = [0, 300, 20]
velocity_m_s = [0, -15, -1]
sigma_position_m = [1, 5, 1]
sigma_velocity_m_s = 2
[dgps]
epoch_utc = 2025-05-08T11:59:00Z
date = 2025-05-08
geoid_separation_m = 37.7
base = [35.68, 139.76, 60.0]
instance = 0
[[phase]]
from_s = 0.5
to_s = 2
background = "sky"
"""
_DGPS = "t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,status\n1,0,300,20,1,1,1,fix\n1.2,0,297,20,,,,float\n"
_TRUTH = "t_s,x_m,y_m,z_m,left_u_px,left_v_px\n1,0,300,20,31,23\n1.1,0,299,20,,\n"
_PIXELS = "t_s,station,u_px,v_px\n1,left,31,23\n1,right,30,22\n"
_ANGLES = (
    "utc,left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg\n"
    "2025-05-08T11:59:01.0Z,1,2,3,4\n2025-05-08T11:59:01.1Z,1.1,,3,4\n"
)
_TUNING = 'start = "search"\n[estimation]\nacceleration_psd_m2_s3 = [1.0, 4.0, 1.0]\n[detection]\nroi_sigmas = 5.0\n'
_EPOCH = "2025-05-08T11:59:00Z"
_PAIRS = 4


VIDEOS = {"avi/left.avi": "MJPG", "mp4/left.mp4": "mp4v", "mkv/left.mkv": "FFV1"}
SUMMARY = "results/summary.json"
# a hundred times as long as a table each, and so not read as often
SLOW = ("left/000001.png", "flight.mcap", *VIDEOS)
_SUMMARY = Path(__file__).parent / "data" / "summary.json"


def session_targets(folder: Path) -> dict[str, Callable[[], object]]:
    """Write the session and the recording into an empty folder; return by file name what reads it."""
    Tiny(rows=4, video="png", session=_SESSION, ptu_from_s=0.9, ptu_to_s=1.4, ptu_step_s=0.1).write(folder)
    for name, text in (
        ("dgps.csv", _DGPS),
        ("truth.csv", _TRUTH),
        ("detections.csv", _PIXELS),
        ("angles.csv", _ANGLES),
        ("config.toml", _TUNING),
    ):
        (folder / name).write_text(text)
    mask = np.ones((3, 5), np.uint8)
    np.savez_compressed(folder / "masks.npz", left_0000=mask, left_0000_xy=np.array([4, 5]))
    (folder / "visibility.csv").write_text(
        "index,station,width_px,in_view,unhidden,snr\n0,left,12.50,1.0000,0.8000,33.10\n1,right,13.00,0.9,1.0,9\n"
    )
    _record(folder / "flight.mcap")
    (folder / SUMMARY).parent.mkdir()
    (folder / SUMMARY).write_bytes(_SUMMARY.read_bytes())
    for name, fourcc in VIDEOS.items():
        path = folder / name
        Tiny(rows=4, video="none", ptu_from_s=0.9, ptu_to_s=1.4, ptu_step_s=0.1).write(path.parent)
        for station in ("left", "right"):
            write_video(path.with_stem(station), range(4), fourcc)
    session = load_session(folder)
    clock = ImportClock(epoch_gps_s=gps_from_text(_EPOCH), starts_s={}, ptu_start_s=0.0)
    return {
        "frames.csv": lambda: read_frames(session),
        "ptu.csv": lambda: _all_angles(session),
        "dgps.csv": lambda: load_dgps(session),
        "truth.csv": lambda: load_truth(session),
        "detections.csv": lambda: read_detections(session),
        "rig.toml": lambda: load_rig(folder / "rig.toml"),
        "session.toml": lambda: load_session(folder),
        "config.toml": lambda: load_config(folder / "config.toml"),
        "angles.csv": lambda: read_angle_table(folder / "angles.csv", session.rig, clock).require_overlap(1.0, 1.3),
        "visibility.csv": lambda: read_visibility(session),
        "masks.npz": lambda: SilhouetteArchive(session).find("left", 0),
        "left/000001.png": lambda: _played(folder),
        "flight.mcap": lambda: _recovered(folder / "flight.mcap"),
        SUMMARY: lambda: _compared((folder / SUMMARY).parent),
        **{name: partial(_watched, folder / name) for name in VIDEOS},
    }


def _record(path: Path) -> None:
    config = type(PATIENT)(patient=True, chunk_bytes=4096, chunk_s=1e9)
    with Recorder(path, small_rig(), header(), config, free_bytes=lambda: 10**12) as recorder:
        for event in recorder.taken(events(_PAIRS, np.random.default_rng(1))):
            recorder.write(looked_at(event))


def _all_angles(session: Session) -> None:
    readings = PtuReadings(session)
    readings.start(0.0, 10.0)
    for _ in readings.until(10.0):
        pass


def _played(path: Path) -> None:
    """Read all events of a session, and the pixels of its frames."""
    with session_source(load_session(path)) as source:
        for event in source:
            _look(event)


def _watched(path: Path) -> None:
    """Read a station's video in every way that there is: for its stamps, for the viewer, as frames, in its session."""
    faults = []
    for way in (
        lambda path: read_video_stamps(path).summary(),
        _embedded,
        _all_frames,
        lambda path: _played(path.parent),
    ):
        try:
            way(path)
        except InputError as fault:
            faults.append(fault)
    if faults:
        raise faults[0]


def _stamped(path: Path) -> None:
    read_video_stamps(path).summary()


def _embedded(path: Path) -> None:
    # Rerun takes no MPEG-4 of 1999, whole or not
    with suppress(SessionError):
        load_video(VideoAsset(path=path))


def _all_frames(path: Path) -> None:
    # a header may announce any number of frames
    for _ in itertools.islice(VideoFile(path).frames(), 100):
        pass


def _compared(folder: Path) -> None:
    """Print a replay's figures in every form."""
    result = compare(CompareRequest(sources=(folder,), work=folder))
    format_comparison(result.runs, result.baseline)
    comparison_csv(result)
    comparison_json(result)


def _look(event: Event) -> None:
    if isinstance(event, Frame):
        # of a recorded one there may be less than the tracker used
        with suppress(PictureError):
            event.image.window(WINDOW)


def _recovered(path: Path) -> None:
    """Play a recording; what does not play is recovered, which may find nothing, and played again."""
    out = path.with_suffix(".again.mcap")
    out.unlink(missing_ok=True)
    try:
        _played(path)
    except RecordingError:
        if recover(path, out).out is not None:
            _played(out)
        raise


class Parts:
    """What a recording is made of, to be written once more under right checksums, a few messages damaged."""

    def __init__(self, path: Path) -> None:
        with McapReader(path) as reader:
            self._contents = reader.contents()
            self._messages = list(reader.messages())

    def write(self, path: Path, chance: random.Random) -> None:
        """Write them to ``path``; a few of messages, attachments and notes are damaged."""
        share = chance.choice((0.005, 0.02, 0.1))

        def perhaps(data: bytes) -> bytes:
            if chance.random() > share:
                return data
            return altered(data, chance) if chance.random() < 0.7 else damaged(data, chance)

        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.LZ4)
            writer.start()
            known: dict[int, int] = {}
            for name, note in self._contents.metadata.items():
                values = {key: perhaps(value.encode()).decode(errors="replace") for key, value in note.items()}
                writer.add_metadata(name, values)
            for name, data in self._contents.attachments.items():
                writer.add_attachment(0, 0, name, "text/plain", perhaps(data))
            for message in self._messages:
                channel, schema = message.channel, message.schema
                if channel.id not in known:
                    number = 0
                    if schema is not None:
                        number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
                writer.add_message(
                    known[channel.id], message.log_time_ns, perhaps(message.data), message.publish_time_ns
                )
            writer.finish()
