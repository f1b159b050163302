"""A folder made for results is taken away where there are none; what was there stays."""

from pathlib import Path

import pytest

from groundstation.errors import InputError
from groundstation.files.new_folder import make_folder, removed_if_empty


@pytest.mark.parametrize("ended", [False, True])
def test_an_empty_new_folder_is_removed(tmp_path: Path, ended: bool) -> None:
    out = tmp_path / "out"

    def run() -> None:
        with removed_if_empty(out):
            make_folder(out)
            if ended:
                raise KeyboardInterrupt

    if ended:
        with pytest.raises(KeyboardInterrupt):
            run()
    else:
        run()
    assert not out.exists()


def test_results_and_older_folders_stay(tmp_path: Path) -> None:
    new, old = tmp_path / "new", tmp_path / "old"
    old.mkdir()
    with removed_if_empty(new), removed_if_empty(old):
        make_folder(new)
        (new / "track.csv").write_text("")
    assert (new / "track.csv").is_file()
    assert old.is_dir()


def test_a_place_for_no_folder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="wanted a folder that can be written"):
        make_folder(tmp_path / "file" / "out")
