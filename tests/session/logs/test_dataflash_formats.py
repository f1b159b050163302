"""Descriptions of messages in an onboard log: one shorter than its own head is not taken."""

from types import SimpleNamespace

import pytest

from groundstation.session.logs.dataflash import _HEAD_BYTES, _Formats


@pytest.mark.parametrize(("length", "taken"), [(_HEAD_BYTES - 1, False), (_HEAD_BYTES, True), (_HEAD_BYTES + 1, True)])
def test_a_message_has_at_least_its_head(length: int, taken: bool) -> None:
    formats = _Formats()
    formats[130] = SimpleNamespace(len=length, name="MODE")
    assert (130 in formats) is taken
