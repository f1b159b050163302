"""Kernels are kept where the user may write; in a folder of the user's own, for what is in it is executed."""

import os
import stat
import tempfile
from pathlib import Path

import pytest

from groundstation.cli.kernel_cache import kernel_cache


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def without(tmp_path: Path) -> tuple[dict[str, str], Path]:
    """An environment and a package where nothing can be made, also by root: their folders are files."""
    (tmp_path / "file").write_text("")
    return {"XDG_CACHE_HOME": str(tmp_path / "file" / "cache")}, tmp_path / "file" / "package"


def test_numba_finds_its_own_where_it_can(tmp_path: Path, temporary: Path) -> None:
    environment, package = without(tmp_path)
    assert kernel_cache(environment | {"NUMBA_CACHE_DIR": "/elsewhere"}, package) == {}
    assert kernel_cache({"XDG_CACHE_HOME": str(tmp_path / "cache")}, package) == {}
    assert kernel_cache(environment, tmp_path / "package") == {}
    assert not list(temporary.iterdir())


def test_else_a_private_folder_that_is_found_again(tmp_path: Path, temporary: Path) -> None:
    environment, package = without(tmp_path)
    found = kernel_cache(environment, package)
    folder = Path(found["NUMBA_CACHE_DIR"])
    assert folder == temporary / f"groundstation-kernels-{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert kernel_cache(environment, package) == found


@pytest.mark.parametrize("kind", ["open", "link"])
def test_a_folder_that_others_may_have_filled_is_not_used(kind: str, tmp_path: Path, temporary: Path) -> None:
    environment, package = without(tmp_path)
    taken = temporary / f"groundstation-kernels-{os.getuid()}"
    if kind == "open":
        taken.mkdir()
        taken.chmod(0o777)
    else:
        (temporary / "theirs").mkdir(mode=0o700)
        taken.symlink_to(temporary / "theirs")
    folder = Path(kernel_cache(environment, package)["NUMBA_CACHE_DIR"])
    assert folder not in (taken, temporary / "theirs")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
