"""STATUSTEXT (253): a line for the pilot's ground station, in parts of 50 bytes."""

from groundstation.autopilot.message import MavlinkMessage

_PART_BYTES = 50
_MOST_PARTS = 4


def status_texts(severity: int, text: str, text_id: int) -> list[MavlinkMessage]:
    """Return the messages of a line; ``text_id`` joins their parts, 0 for a line of one part.

    Longer lines than 200 bytes end there. Bytes outside of ASCII are replaced: ground stations differ in how they show
    them.
    """
    line = text.encode("ascii", "replace")[: _PART_BYTES * _MOST_PARTS]
    # a line of several parts ends with one that is not full
    ends = len(line) + 1 if len(line) > _PART_BYTES else max(len(line), 1)
    parts = [line[k : k + _PART_BYTES] for k in range(0, ends, _PART_BYTES)]
    return [
        MavlinkMessage(
            name="STATUSTEXT",
            fields={
                "severity": severity,
                "text": part,
                "id": text_id if len(parts) > 1 else 0,
                "chunk_seq": k,
            },
        )
        for k, part in enumerate(parts)
    ]
