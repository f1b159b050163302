"""The whole camera file that docs/onboard.md shows is one that the commands read, and has every key of its table."""

import re
import tomllib
from pathlib import Path

import numpy as np

from groundstation.onboard.edges.camera_file import is_camera_file, load_nose_camera
from groundstation.onboard.visual_inertial.inertial_unit_file import load_unit
from tests.docs.pages import ROOT, text_of

_PAGE = ROOT / "docs" / "onboard.md"


def test_the_whole_camera_file_of_the_page_is_read(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", text_of(_PAGE), re.DOTALL)
    path = tmp_path / "nose.toml"
    path.write_text(text)
    camera = load_nose_camera(path)
    assert is_camera_file(path)
    assert camera.unsaid == ()
    assert camera.place is not None
    assert camera.start is not None
    np.testing.assert_allclose(camera.start.camera_threshold_m, [1.5, 330.0, 24.0])
    np.testing.assert_allclose(load_unit(path, camera).mount.camera_in_body_m, [0.4, 0.0, 0.1])


def test_every_key_of_the_table_is_in_the_whole_file() -> None:
    """Expected: neither shows a key that the other does not, but for the unit's noise, which has its own page."""
    (text,) = re.findall(r"```toml\n(.*?)```", text_of(_PAGE), re.DOTALL)
    reported = tomllib.loads(text)
    shown = {name for name, value in reported.items() if not isinstance(value, dict)}
    shown |= {name for value in reported.values() if isinstance(value, dict) for name in value}
    table = text_of(_PAGE).partition("`--camera`, TOML:")[2].partition("A whole one")[0]
    named = {
        name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1] if "|" in row else "")
    }
    assert named == shown - {"camera_in_body_m"}
