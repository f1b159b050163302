"""Requirements of Foxglove on a recording, tested by MCAP's own reader and by Foxglove's own messages.

Foxglove itself is a desktop program that cannot run here: it reads the container, then each message by the schema that
the file carries, and knows what to draw by the schema's name. These three are held to the makers' own code.
"""

import importlib
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.reader import make_reader

from groundstation.messages import CameraReport, Kinematics, StepReport
from groundstation.recording import mcap_schemas
from groundstation.recording.recorder import Recorder, RecorderConfig
from tests.recording.recorded import events, header, looked_at, small_rig

PAIRS = 20
# https://docs.foxglove.dev/docs/sdk/schemas/raw-image
ENCODINGS = {"bayer_rggb8": 1, "bayer_grbg8": 1, "bayer_gbrg8": 1, "bayer_bggr8": 1, "mono8": 1, "bgr8": 3, "rgb8": 3}


class Read(NamedTuple):
    """One message as Foxglove would have it."""

    topic: str
    schema: str
    message: Any
    stamp_ns: int


def official(kind: str) -> Any:
    """Foxglove's own class of a message."""
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{kind}_pb2"), kind)


def located(report: StepReport) -> StepReport:
    """A step's report with a place of the target, and with angles, so that viewers have something to draw."""
    kinematics = Kinematics(
        position_runway_m=np.array([1.0, 200.0, 9.0]), velocity_runway_m_s=np.zeros(3), covariance=np.eye(6)
    )
    estimates = tuple(replace(e, kinematics=kinematics) for e in report.estimates)
    cameras: tuple[CameraReport, ...] = tuple(replace(c, pan_rad=0.1, tilt_rad=0.05) for c in report.cameras)
    return StepReport(cameras=cameras, estimates=estimates, events=report.events)


@pytest.fixture(scope="module", params=[2.0, 0.0], ids=["packed", "raw"])
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("foxglove") / "flight.mcap"
    config = RecorderConfig(patient=True, chunk_bytes=8192, chunk_s=1e9, png_fill=request.param)
    with Recorder(path, small_rig(), header(), config, free_bytes=lambda: 10**12) as recorder:
        for event in recorder.taken(events(PAIRS, np.random.default_rng(1))):
            recorder.write(located(looked_at(event)))
    return path


def read_by_own_schema(path: Path) -> Iterator[Read]:
    """Read a file as Foxglove does: each message by the descriptors that the file itself carries."""
    classes: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            if channel.message_encoding == "json":
                yield Read(channel.topic, schema.name, json.loads(message.data), message.log_time)
                continue
            if schema.id not in classes:
                pool = descriptor_pool.DescriptorPool()
                for one in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                    pool.Add(one)
                classes[schema.id] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            yield Read(channel.topic, schema.name, classes[schema.id].FromString(message.data), message.log_time)


@pytest.mark.parametrize("kind", sorted(mcap_schemas._MESSAGES))
def test_every_standard_message_is_foxgloves(kind: str) -> None:
    """Expected: name, and of each field name, number, type and whether it repeats; and each level of a log."""
    theirs, ours = official(kind).DESCRIPTOR, mcap_schemas._CLASSES[kind].DESCRIPTOR
    assert ours.full_name == theirs.full_name
    for field in ours.fields:
        other = theirs.fields_by_name[field.name]
        assert (field.number, field.type, field.is_repeated) == (other.number, other.type, other.is_repeated)
        if field.message_type is not None:
            assert field.message_type.full_name == other.message_type.full_name
    assert {f.name for f in theirs.fields} == {f.name for f in ours.fields}
    for name, kinds in ours.enum_types_by_name.items():
        levels = {v.name: v.number for v in theirs.enum_types_by_name[name].values}
        assert {v.name: v.number for v in kinds.values} == levels


def test_the_container_is_whole_by_its_makers_reader(recording: Path) -> None:
    """Expected: all checksums are right; index and statistics match the content; schemas and encodings are known."""
    with recording.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counted = Counter(channel.id for _, channel, _ in reader.iter_messages())
        assert counted == summary.statistics.channel_message_counts
        assert sum(counted.values()) == summary.statistics.message_count
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 3
        assert {a.name for a in reader.iter_attachments()} == {"session.toml", "rig.toml", "config.toml"}
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (channel.message_encoding, schema.encoding) in (("json", "jsonschema"), ("protobuf", "protobuf"))
            if schema.encoding == "jsonschema":
                assert json.loads(schema.data)["type"] == "object"
            else:
                assert schema.name.removeprefix("foxglove.") in mcap_schemas._MESSAGES


def test_each_message_reads_the_same_by_its_own_schema_and_by_foxgloves(recording: Path) -> None:
    """Expected: nothing is left over, and every stamp is that of the container."""
    seen: Counter[str] = Counter()
    with recording.open("rb") as file:
        raw = [m.data for _, c, m in make_reader(file).iter_messages() if c.message_encoding == "protobuf"]
    standard = [r for r in read_by_own_schema(recording) if r.schema.startswith("foxglove.")]
    assert len(raw) == len(standard)
    for data, read in zip(raw, standard, strict=True):
        kind = read.schema.removeprefix("foxglove.")
        theirs = official(kind).FromString(data)
        assert len(UnknownFieldSet(theirs)) == 0
        assert theirs.SerializeToString(deterministic=True) == read.message.SerializeToString(deterministic=True)
        assert timestamp_pb2.Timestamp.FromString(theirs.timestamp.SerializeToString()).ToNanoseconds() == read.stamp_ns
        seen[kind] += 1
    assert {"CameraCalibration", "FrameTransform", "PoseInFrame", "Log"} <= set(seen)


def test_what_is_drawn_can_be_drawn(recording: Path) -> None:
    """Expected: pictures decode to their size, frames hang together, attitudes are unit quaternions."""
    frames = set()
    pictures = 0
    for read in read_by_own_schema(recording):
        message = read.message
        if read.schema == "foxglove.CompressedImage":
            pictures += 1
            assert message.format == "png"
            assert cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED) is not None
        elif read.schema == "foxglove.RawImage":
            pictures += 1
            assert message.step == ENCODINGS[message.encoding] * message.width
            assert len(message.data) == message.step * message.height
        elif read.schema == "foxglove.FrameTransform":
            q = message.rotation
            assert np.isclose(q.x**2 + q.y**2 + q.z**2 + q.w**2, 1.0)
            assert message.parent_frame_id == "runway"
            frames.add(message.child_frame_id)
        elif read.schema == "foxglove.CameraCalibration":
            assert (len(message.K), len(message.R), len(message.P)) == (9, 9, 12)
            assert read.topic.startswith("/stations/")
    assert frames == {"left/camera", "right/camera"}
    assert pictures == 2 * PAIRS
