"""A medium that is longer than its table is a fault, and the first one is reported."""

from types import SimpleNamespace

import pytest

from groundstation.errors import SessionError
from groundstation.sources.folder_source import FolderSource


def faulty(name: str) -> SimpleNamespace:
    def following() -> None:
        raise SessionError(name, got="one picture more", wanted="none")

    return SimpleNamespace(next=following)


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_the_first_fault_is_kept(order: tuple[str, str]) -> None:
    source = FolderSource.__new__(FolderSource)
    source._fault, source._readers = None, {name: faulty(name) for name in order}
    source._check_ends()
    assert str(source._fault).startswith(order[0])
    before = SessionError("before", got="a", wanted="b")
    source._fault = before
    source._check_ends()
    assert source._fault is before
