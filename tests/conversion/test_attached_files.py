"""Files that a recording carries, read like those of a folder."""

import pytest

from groundstation.files.text_file import AttachedFiles


def test_one_that_is_there_is_read_and_one_that_is_not_is_missed() -> None:
    files = AttachedFiles("flight.mcap", {"rig.toml": b"a = 1\n"})
    there, missing = files / "rig.toml", files / "session.toml"
    assert there.is_file()
    assert there.read_bytes() == b"a = 1\n"
    assert there.open(encoding="utf-8").read() == "a = 1\n"
    assert (there.name, str(there)) == ("rig.toml", "flight.mcap: rig.toml")
    assert not missing.is_file()
    with pytest.raises(FileNotFoundError) as raised:
        missing.read_bytes()
    assert raised.value.filename == "flight.mcap: session.toml"
