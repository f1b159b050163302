"""A Rerun recording of a session that cannot be replayed yet: its pictures, its stations, its references."""

from pathlib import Path

import numpy as np
import rerun as rr

from groundstation.errors import MissingExtraError, SessionError
from groundstation.session import MediumKind, Session, load_dgps, load_truth
from groundstation.sinks import rerun_tree as tree
from groundstation.sinks.rerun_columns import Batch
from groundstation.sinks.rerun_media import VideoAsset, encoded_image, load_video
from groundstation.sinks.rerun_reference import ReferenceLine, log_reference_line
from groundstation.sinks.rerun_scene import log_pedestal, log_runway, log_world, long_enough, outline_between
from groundstation.sources.frame_table import read_frames
from groundstation.sources.pictures import image_files


def recording_of_session(session: Session, path: Path) -> tuple[str, ...]:
    """Write what a session holds without a replay and return it in words, an item each; empty where there is nothing.

    A reference stands in its own clock. What cannot be read is passed over: why the session is not replayed has
    been said already.
    """
    stream = rr.RecordingStream("groundstation", send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.save(path)
    stream.send_recording_name(session.name)
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
    stream.flush()
    stream.disconnect()
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
                video = load_video(VideoAsset(path=medium.path))
                stream.log(tree.image(name), video.asset, static=True)
                in_video = numbers < len(video.timestamps_ns)
                columns = rr.VideoFrameReference.columns_nanos(video.timestamps_ns[numbers[in_video]])
                Batch(entity=tree.image(name), t_s=stamps_s[in_video], columns=columns).send(stream)
            elif medium.kind is MediumKind.IMAGES:
                files = image_files(medium.path)
                for t_s, number in zip(stamps_s, numbers, strict=True):
                    if int(number) in files:
                        stream.set_time(tree.TIMELINE, duration=np.timedelta64(round(float(t_s) * 1e9), "ns"))
                        stream.log(tree.image(name), encoded_image(files[int(number)]))
            else:
                continue
        except SessionError:
            continue
        shown.append(name)
    return shown
