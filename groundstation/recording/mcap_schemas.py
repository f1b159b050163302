"""Standard messages for viewers as Protocol Buffers, with the names and field numbers of Foxglove's schemas.

Only the messages and fields that a recording uses are described. https://docs.foxglove.dev/docs/sdk/schemas
"""

from collections.abc import Sequence
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

_FILE = "groundstation/standard.proto"
_PACKAGE = "foxglove"
_KIND = descriptor_pb2.FieldDescriptorProto
_STAMP = ".google.protobuf.Timestamp"
_SCALARS = {
    "double": _KIND.TYPE_DOUBLE,
    "fixed32": _KIND.TYPE_FIXED32,
    "string": _KIND.TYPE_STRING,
    "bytes": _KIND.TYPE_BYTES,
}
LOG_LEVELS = {"unknown": 0, "debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}

# name, number, type; "*" repeats
_MESSAGES: dict[str, Sequence[tuple[str, int, str]]] = {
    "Vector3": (("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")),
    "Quaternion": (("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double"), ("w", 4, "double")),
    "Pose": (("position", 1, ".foxglove.Vector3"), ("orientation", 2, ".foxglove.Quaternion")),
    "CompressedImage": (
        ("timestamp", 1, _STAMP),
        ("frame_id", 4, "string"),
        ("data", 2, "bytes"),
        ("format", 3, "string"),
    ),
    "RawImage": (
        *(("timestamp", 1, _STAMP), ("frame_id", 7, "string"), ("width", 2, "fixed32"), ("height", 3, "fixed32")),
        *(("encoding", 4, "string"), ("step", 5, "fixed32"), ("data", 6, "bytes")),
    ),
    "PoseInFrame": (("timestamp", 1, _STAMP), ("frame_id", 2, "string"), ("pose", 3, ".foxglove.Pose")),
    "FrameTransform": (
        *(("timestamp", 1, _STAMP), ("parent_frame_id", 2, "string"), ("child_frame_id", 3, "string")),
        *(("translation", 4, ".foxglove.Vector3"), ("rotation", 5, ".foxglove.Quaternion")),
    ),
    "CameraCalibration": (
        *(("timestamp", 1, _STAMP), ("frame_id", 9, "string"), ("width", 2, "fixed32"), ("height", 3, "fixed32")),
        *(("distortion_model", 4, "string"), ("D", 5, "*double"), ("K", 6, "*double"), ("R", 7, "*double")),
        ("P", 8, "*double"),
    ),
    "Log": (
        *(("timestamp", 1, _STAMP), ("level", 2, "=.foxglove.Log.Level"), ("message", 3, "string")),
        *(("name", 4, "string"), ("file", 5, "string"), ("line", 6, "fixed32")),
    ),
}


def _described() -> descriptor_pb2.FileDescriptorProto:
    """Return the description of all messages."""
    file = descriptor_pb2.FileDescriptorProto(name=_FILE, package=_PACKAGE, syntax="proto3")
    file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
    for name, fields in _MESSAGES.items():
        message = file.message_type.add(name=name)
        if name == "Log":
            levels = message.enum_type.add(name="Level")
            for word, number in LOG_LEVELS.items():
                levels.value.add(name=word.upper(), number=number)
        for field, number, kind in fields:
            entry = message.field.add(name=field, number=number)
            entry.label = _KIND.LABEL_REPEATED if kind[0] == "*" else _KIND.LABEL_OPTIONAL
            if kind[0] in ".=":
                entry.type = _KIND.TYPE_ENUM if kind[0] == "=" else _KIND.TYPE_MESSAGE
                entry.type_name = kind.lstrip("=")
            else:
                entry.type = _SCALARS[kind.lstrip("*")]
    return file


_DESCRIBED = _described()
_POOL = descriptor_pool.DescriptorPool()
_POOL.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
_POOL.Add(_DESCRIBED)
_CLASSES: dict[str, Any] = {
    name: message_factory.GetMessageClass(_POOL.FindMessageTypeByName(f"{_PACKAGE}.{name}")) for name in _MESSAGES
}


def schema_data() -> bytes:
    """Return the descriptors that a file carries, the same for every standard message."""
    stamps = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    data: bytes = descriptor_pb2.FileDescriptorSet(file=[stamps, _DESCRIBED]).SerializeToString()
    return data


def schema_name(kind: str) -> str:
    """Return the full name of a standard message."""
    return f"{_PACKAGE}.{kind}"


def encode(kind: str, *, stamp_ns: int, **fields: Any) -> bytes:
    """Return one standard message; nested messages are given as mappings."""
    seconds, nanos = divmod(stamp_ns, 1_000_000_000)
    data: bytes = _CLASSES[kind](timestamp={"seconds": seconds, "nanos": nanos}, **fields).SerializeToString()
    return data


def decode(kind: str, data: bytes) -> Any:
    """Return a standard message of any file; raises ``google.protobuf.message.DecodeError``."""
    return _CLASSES[kind].FromString(data)
