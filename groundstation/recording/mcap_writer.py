"""The messages of a recording: events, notes, pictures, outputs, and standard messages for viewers."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from groundstation.box import Box
from groundstation.errors import InputError
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.messages import CameraReport, TrackEstimate, TrackEvent, TrackState
from groundstation.picture import Picture, PicturePart
from groundstation.recording import mcap_schemas
from groundstation.recording.buffered_output import BufferedOutput, as_stream
from groundstation.recording.event_codec import (
    DroppedNote,
    LostNote,
    Note,
    PartNote,
    PixelsNote,
    line,
    note_values,
    stamp_ns,
)
from groundstation.recording.event_counter import EventCounter
from groundstation.recording.image_codec import encode_image
from groundstation.recording.mcap_metadata import (
    ABOUT,
    CAMERAS_TOPIC,
    END,
    EVENTS_TOPIC,
    STATES_TOPIC,
    TRACK_TOPIC,
    RecordingHeader,
    header_values,
    statistics_values,
)
from groundstation.recording.output_codec import camera_values, estimate_values, state_values
from groundstation.recording.write_queue import EventItem, OutputItem, PixelsItem, QueueItem
from groundstation.rig.rig import Rig, Station

_JSON_SCHEMA = b'{"type":"object"}'
_JSON_TOPICS = {
    EVENTS_TOPIC: "groundstation.Event",
    TRACK_TOPIC: "groundstation.Estimate",
    CAMERAS_TOPIC: "groundstation.Camera",
    STATES_TOPIC: "groundstation.State",
}
_MAX_FILE_BYTES = 64 * 2**20
_IDENTITY = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


class McapWriter:
    """Writes the records of one run into a container.

    Parameters
    ----------
    chunk_bytes : size at which a chunk is closed; `flush` closes it earlier.
    """

    def __init__(self, output: BufferedOutput, rig: Rig, header: RecordingHeader, chunk_bytes: int) -> None:
        self._geometries = {s.name: s.geometry() for s in rig.stations}
        self._fixed = {s.name for s in rig.stations if s.fixed}
        self._writer = Writer(as_stream(output), chunk_size=chunk_bytes, compression=CompressionType.LZ4)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._now_ns = 0
        self._end = EventCounter()
        self._writer.start(profile="", library="groundstation")
        self._writer.add_metadata(ABOUT, header_values(header))
        for name, data in header.files.items():
            self.attach(name, data)
        self._uncalibrated = list(rig.stations)

    def attach(self, name: str, data: bytes) -> None:
        """Attach a file of the session; raises `InputError` if it is too large."""
        if len(data) > _MAX_FILE_BYTES:
            wanted = f"at most {_MAX_FILE_BYTES >> 20} MiB to go into a recording"
            raise InputError(name, got=f"{len(data)} bytes", wanted=wanted)
        media = "application/toml" if name.endswith(".toml") else "text/csv"
        self._writer.add_attachment(0, self._now_ns, name, media, data)

    def put(self, item: QueueItem, *, png: bool) -> None:
        """Write one item; pictures as PNG, or uncompressed without ``png``."""
        if isinstance(item, EventItem):
            self._now_ns = stamp_ns(item.t_s)
            while self._uncalibrated:
                self._calibration(self._uncalibrated.pop())
            self._end.add(item.values)
            self._json(EVENTS_TOPIC, item.values, self._now_ns, item.n)
        elif isinstance(item, PixelsItem):
            self._pixels(item, png)
        else:
            self._answer(item)

    def note_lost(self, first: int, last: int) -> None:
        """Write a note on a range of events that are missing from the file."""
        self._note(LostNote(first=first, last=last), self._now_ns)

    def flush(self) -> None:
        """Close the current chunk."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the closing record and the index."""
        self._writer.add_metadata(END, statistics_values(self._end.result()))
        self._writer.finish()

    # -------------------------------------------------------------------------------------------- pictures
    def _pixels(self, item: PixelsItem, png: bool) -> None:
        """Write a note on the recorded parts of a frame, then their pictures."""
        stamp = stamp_ns(item.t_s)
        if item.source is None:
            self._note(DroppedNote(of=item.of, why=item.dropped), stamp)
            return
        whole = isinstance(item.source, Picture)
        kept = list(_kept(item.source))
        ends = [("image" if whole else f"window/{k}") + ("" if png else "/raw") for k in range(len(kept))]
        parts = tuple(
            PartNote(topic=end, x=p.x, y=p.y, w=p.pixels.shape[1], h=p.pixels.shape[0])
            for end, p in zip(ends, kept, strict=True)
        )
        colour = bool(kept) and kept[0].pixels.ndim == 3
        self._note(PixelsNote(of=item.of, parts=parts, colour=colour), stamp)
        for end, part in zip(ends, kept, strict=True):
            topic, frame = f"/stations/{item.station}/{end}", f"{item.station}/camera"
            data = encode_image(part.pixels, png=png, pattern=item.pattern, stamp_ns=stamp, frame_id=frame)
            self._add(topic, "CompressedImage" if png else "RawImage", data, stamp, item.of)

    # --------------------------------------------------------------------------------------------- answers
    def _answer(self, item: OutputItem) -> None:
        content = item.content
        if isinstance(content, TrackEstimate):
            stamp = stamp_ns(content.t_s)
            self._json(TRACK_TOPIC, estimate_values(content) | {"latency_s": content.latency_s}, stamp, content.epoch)
            self._pose(content, stamp)
        elif isinstance(content, TrackState):
            stamp = stamp_ns(content.t_s)
            self._json(STATES_TOPIC, state_values(content), stamp, 0)
            self._pose(content, stamp)
        elif isinstance(content, CameraReport):
            stamp = stamp_ns(content.t_s)
            self._json(CAMERAS_TOPIC, camera_values(content), stamp, content.epoch)
            self._transform(content, stamp)
        elif isinstance(content, TrackEvent):
            level = mcap_schemas.LOG_LEVELS.get(content.level, mcap_schemas.LOG_LEVELS["info"])
            self._standard("/log", "Log", stamp_ns(content.t_s), level=level, message=content.text, name="pipeline")
        else:
            name, data = content
            self.attach(name, data)

    def _pose(self, estimate: TrackEstimate | TrackState, stamp: int) -> None:
        if estimate.kinematics is None or not np.isfinite(estimate.kinematics.position_runway_m).all():
            return
        x, y, z = (float(v) for v in estimate.kinematics.position_runway_m)
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": _IDENTITY}
        self._standard("/track/pose", "PoseInFrame", stamp, frame_id="runway", pose=pose)

    def _transform(self, camera: CameraReport, stamp: int) -> None:
        """Write the pose of a camera, for the 3-D scenes of viewers."""
        fixed = camera.station in self._fixed
        if not fixed and (camera.pan_rad is None or camera.tilt_rad is None):
            return
        pose = self._geometries[camera.station].camera_pose(camera.pan_rad or 0.0, camera.tilt_rad or 0.0)
        x, y, z = (float(v) for v in pose.position_runway_m)
        qw, qx, qy, qz = (float(v) for v in wxyz_from_matrix(pose.runway_from_camera))
        self._standard(
            "/tf",
            "FrameTransform",
            stamp,
            parent_frame_id="runway",
            child_frame_id=f"{camera.station}/camera",
            translation={"x": x, "y": y, "z": z},
            rotation={"x": qx, "y": qy, "z": qz, "w": qw},
        )

    def _calibration(self, station: Station) -> None:
        lens = station.lens
        (fx, fy), (cx, cy) = (map(float, pair) for pair in (lens.focal_px, lens.principal_point_px))
        self._standard(
            f"/stations/{station.name}/calibration",
            "CameraCalibration",
            self._now_ns,
            frame_id=f"{station.name}/camera",
            width=lens.image_size_px[0],
            height=lens.image_size_px[1],
            distortion_model="plumb_bob",
            D=[float(v) for v in lens.distortion],
            K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        )

    # ------------------------------------------------------------------------------------------- messages
    def _note(self, note: Note, stamp: int) -> None:
        self._json(EVENTS_TOPIC, note_values(note), stamp, 0)

    def _json(self, topic: str, values: dict[str, Any], stamp: int, number: int) -> None:
        self._message(topic, _JSON_TOPICS[topic], "jsonschema", line(values), stamp, number)

    def _standard(self, topic: str, kind: str, stamp: int, **fields: Any) -> None:
        self._add(topic, kind, mcap_schemas.encode(kind, stamp_ns=stamp, **fields), stamp, 0)

    def _add(self, topic: str, kind: str, data: bytes, stamp: int, number: int) -> None:
        self._message(topic, mcap_schemas.schema_name(kind), "protobuf", data, stamp, number)

    def _message(self, topic: str, schema: str, encoding: str, data: bytes, stamp: int, number: int) -> None:
        """Write a message; its schema and channel are registered before the first one."""
        channel = self._channels.get(topic)
        if channel is None:
            json = encoding == "jsonschema"
            if schema not in self._schemas:
                described = _JSON_SCHEMA if json else mcap_schemas.schema_data()
                self._schemas[schema] = self._writer.register_schema(schema, encoding, described)
            channel = self._writer.register_channel(topic, "json" if json else encoding, self._schemas[schema])
            self._channels[topic] = channel
        self._writer.add_message(
            channel_id=channel, log_time=stamp, publish_time=stamp, data=data, sequence=number & 0xFFFFFFFF
        )


def _kept(source: Sequence[PicturePart] | Picture) -> Iterator[PicturePart]:
    """Return the parts to write: the copied windows, or the whole picture."""
    if isinstance(source, Picture):
        yield source.recordable(Box(0, 0, *source.size_px))
    else:
        yield from source
