"""The descriptors that a recording carries: each field has its type, as readers without a pool need it."""

from google.protobuf import descriptor_pb2

from groundstation.recording.mcap_schemas import schema_data


def test_every_field_has_a_type_and_named_ones_their_name() -> None:
    files = descriptor_pb2.FileDescriptorSet.FromString(schema_data()).file
    fields = [field for file in files for message in file.message_type for field in message.field]
    assert len(fields) > 10
    assert all(field.HasField("type") for field in fields)
    named = (descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE, descriptor_pb2.FieldDescriptorProto.TYPE_ENUM)
    assert all((field.type in named) == bool(field.type_name) for field in fields)
