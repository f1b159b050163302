"""A Rerun recording of a session that cannot be replayed: its pictures, stations and references."""

from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import InputError, MissingExtraError, SessionError
from groundstation.session import MediumKind, Session, load_dgps, load_truth
from groundstation.session.media import image_files, read_image
from groundstation.sources.frame_table import read_frames
from groundstation.sources.video_file import VideoFile
from groundstation.viewer import entity_paths
from groundstation.viewer.columns import ColumnBatch
from groundstation.viewer.media import VideoAsset, log_video
from groundstation.viewer.picture_channel import PictureChannel
from groundstation.viewer.recording_file import written_recording
from groundstation.viewer.reference_lines import ReferenceLine, log_reference_line
from groundstation.viewer.scene import log_pedestal, log_runway, log_world, long_enough, outline_between


def write_session_recording(session: Session, path: Path) -> tuple[str, ...]:
    """Write the contents of a session without a replay and return their descriptions; empty if there are none.

    A reference keeps its own clock. Unreadable files are skipped: the fault that prevents a replay is reported
    by the caller.
    """
    with written_recording(path, "groundstation", session.name) as stream:
        return _log_session(stream, session)


def _log_session(stream: rr.RecordingStream, session: Session) -> tuple[str, ...]:
    log_world(stream)
    middle_m = np.mean([s.ptu_position_m for s in session.rig.stations], axis=0)
    for number, station in enumerate(session.rig.stations):
        if "position" in station.known:
            log_pedestal(stream, station, number, middle_m)
    lines = _references(session)
    furthest_m = max((float(line.position_runway_m[:, 1].max()) for line in lines), default=0.0)
    log_runway(stream, long_enough(outline_between(session.rig), furthest_m))
    for line in lines:
        log_reference_line(stream, line)
    pictures = _log_pictures(stream, session)
    shown = [f"pictures of {' and '.join(pictures)}"] if pictures else []
    return (*shown, *({"dgps": "the DGPS path", "truth": "the true path"}[line.name] for line in lines))


def _references(session: Session) -> list[ReferenceLine]:
    """Return the references as lines, as far as they can be read."""
    lines = []
    truth = load_truth(session, lambda fault: None)
    if truth is not None and len(truth.t_s):
        lines.append(ReferenceLine(name="truth", t_s=truth.t_s, position_runway_m=truth.position_runway_m))
    try:
        fixes = load_dgps(session, lambda fault: None)
    except MissingExtraError:
        return lines
    if fixes:
        points = np.array([fix.position_runway_m for fix in fixes])
        lines.append(ReferenceLine(name="dgps", t_s=np.array([f.t_s for f in fixes]), position_runway_m=points))
    return lines


def _log_pictures(stream: rr.RecordingStream, session: Session) -> list[str]:
    """Log every station's frames at their stamps; returns the stations that have some."""
    try:
        table = read_frames(session)
    except SessionError:
        return []
    shown = []
    for name, medium in session.media.items():
        there = np.isfinite(table.stamps_s[name])
        stamps_s, numbers = table.stamps_s[name][there], table.numbers[name][there]
        try:
            if medium.kind is MediumKind.VIDEO:
                _log_video(stream, name, medium.path, stamps_s, numbers)
            elif medium.kind is MediumKind.IMAGES:
                channel = PictureChannel(name, expected=len(numbers))
                files = image_files(medium.path)
                for t_s, number in zip(stamps_s, numbers, strict=True):
                    picture = read_image(files[int(number)]) if int(number) in files else None
                    if isinstance(picture, np.ndarray):
                        _send(stream, channel, float(t_s), int(number), picture)
                _finish(stream, channel)
            else:
                continue
        except InputError:
            continue
        shown.append(name)
    return shown


def _log_video(
    stream: rr.RecordingStream, name: str, path: Path, stamps_s: FloatArray, numbers: NDArray[np.int64]
) -> None:
    """Log a station's video as it is, or picture by picture where Rerun cannot read it."""
    try:
        video = log_video(stream, entity_paths.image(name), VideoAsset(path=path))
    except SessionError:
        channel, wanted = (
            PictureChannel(name, expected=len(numbers)),
            dict(zip(numbers.tolist(), stamps_s, strict=True)),
        )
        for frame in VideoFile(path).frames():
            if frame.index in wanted:
                _send(stream, channel, float(wanted[frame.index]), frame.index, frame.image)
        _finish(stream, channel)
        return
    inside = numbers < len(video)
    columns = video.references(numbers[inside])
    ColumnBatch(entity=entity_paths.image(name), t_s=stamps_s[inside], columns=columns).send(stream)


def _send(stream: rr.RecordingStream, channel: PictureChannel, t_s: float, number: int, picture: ImageArray) -> None:
    channel.add_picture(t_s, number, picture)
    if channel.full:
        _finish(stream, channel)


def _finish(stream: rr.RecordingStream, channel: PictureChannel) -> None:
    for batch in channel.take():
        batch.send(stream)
