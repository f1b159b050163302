"""Recovery after a crash: copies the intact part of a recording to a new, closed file."""

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import CompressionType, Writer

from groundstation.errors import InputError, RecordingError
from groundstation.recording.event_counter import EventCounter
from groundstation.recording.mcap_metadata import ABOUT, END, EVENTS_TOPIC, statistics_values
from groundstation.recording.mcap_reader import McapContents, McapMessage, McapReader

_CHUNK_BYTES = 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveryResult:
    """Result of a recovery.

    Attributes
    ----------
    out : the file written; None if the recording is intact.
    messages : how many messages of each topic it holds, as counted by reading it again.
    chunks : how many chunks were read.
    skipped : how many damaged chunks were left out.
    lost_bytes : size of the data after the last intact record of the old file.
    fault : description of the fault that ended the old file.
    """

    out: Path | None
    messages: dict[str, int]
    chunks: int
    skipped: int
    lost_bytes: int
    fault: str


def recover(path: Path, out: Path | None = None) -> RecoveryResult:
    """Copy all complete chunks of ``path`` into a new recording; the old one is not modified.

    ``out`` is a file that does not exist yet, by default NAME-recovered.mcap in the same folder. Raises `InputError`
    if nothing can be recovered, or if the new file does not read back as written.
    """
    with McapReader(path) as reader:
        out = path.with_name(f"{path.stem}-recovered.mcap") if out is None else out
        contents = reader.contents()
        skipped: list[RecordingError] = []
        if contents.fault is None:
            counts = _counted(reader, skipped)
            if not skipped:
                return _result(None, counts, contents, 0, 0)
            skipped.clear()
        if out.exists():
            raise InputError(str(out), got="a file that exists", wanted="a new one: recordings are kept")
        written = _copy(reader, contents, out, skipped)
    if not written:
        out.unlink()
        raise RecordingError(str(path), got="no complete chunk", wanted="at least one")
    with McapReader(out) as copy:
        fault, counts = copy.contents().fault, _counted(copy, [])
    if fault is not None or counts != written:
        got = f"{sum(counts.values())} messages on reading it again"
        raise RecordingError(str(out), got=got, wanted=f"the {sum(written.values())} that were copied")
    return _result(out, counts, contents, len(skipped), path.stat().st_size - contents.whole_bytes)


def _result(
    out: Path | None, counts: Counter[str], contents: McapContents, skipped: int, lost_bytes: int
) -> RecoveryResult:
    return RecoveryResult(
        out=out,
        messages=dict(sorted(counts.items())),
        chunks=contents.chunks,
        skipped=skipped,
        lost_bytes=lost_bytes,
        fault="" if contents.fault is None else contents.fault.got,
    )


def _counted(reader: McapReader, skipped: list[RecordingError]) -> Counter[str]:
    """Count the messages of each topic."""
    counts: Counter[str] = Counter()
    for message in reader.messages(skipped.append):
        counts[message.topic] += 1
    return counts


def _copy(reader: McapReader, contents: McapContents, out: Path, skipped: list[RecordingError]) -> Counter[str]:
    """Copy all intact messages to a new file; returns the number of messages by topic."""
    counts: Counter[str] = Counter()
    end = EventCounter()
    with out.open("xb") as file:
        writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.LZ4)
        writer.start(profile="", library="groundstation")
        for name, values in contents.metadata.items():
            if name != END:
                writer.add_metadata(name, values)
        for name, data in contents.attachments.items():
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
        channels: dict[str, int] = {}
        try:
            for message in reader.messages(skipped.append):
                if message.topic not in channels:
                    channels[message.topic] = _announce(writer, message)
                _add(writer, channels[message.topic], message)
                counts[message.topic] += 1
                if message.topic == EVENTS_TOPIC:
                    end.add_line(message.data)
        except RecordingError:
            # end of the intact data; its place is in `contents`
            pass
        if ABOUT in contents.metadata:
            writer.add_metadata(END, statistics_values(end.result()))
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return counts


def _announce(writer: Writer, message: McapMessage) -> int:
    """Register a message's schema and channel in the new file."""
    channel, schema = message.channel, message.schema
    number = 0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
    return writer.register_channel(channel.topic, channel.message_encoding, number, channel.metadata)


def _add(writer: Writer, channel: int, message: McapMessage) -> None:
    writer.add_message(
        channel_id=channel,
        log_time=message.log_time_ns,
        publish_time=message.publish_time_ns,
        data=message.data,
        sequence=message.sequence,
    )
