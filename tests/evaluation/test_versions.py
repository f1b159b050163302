"""The versions that stand in a report."""

from importlib import metadata

import pytest

from groundstation.evaluation.summary import versions


def test_what_is_not_installed_is_named_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = metadata.version

    def version(name: str) -> str:
        if name == "numba":
            raise metadata.PackageNotFoundError(name)
        return plain(name)

    monkeypatch.setattr(metadata, "version", version)
    found = versions()
    assert found["numba"] == "not installed"
    assert found["numpy"] == plain("numpy")
