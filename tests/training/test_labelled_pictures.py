"""One's own labelled pictures for fine-tuning: what is read, and what is refused with its name."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.errors import GroundstationError
from training.labelled_pictures import labelled_pictures


def write(folder: Path, name: str, x0: int = 100, width: int = 40, size: tuple[int, int] = (320, 240)) -> None:
    image = np.full((size[1], size[0], 3), 200, np.uint8)
    mask = np.zeros(image.shape[:2], np.uint8)
    mask[100:110, x0 : x0 + width] = 255
    image[mask > 0] = 30
    cv2.imwrite(str(folder / f"{name}.png"), image)
    cv2.imwrite(str(folder / f"{name}.mask.png"), mask)


def test_targets_with_and_without_a_nose(tmp_path: Path) -> None:
    write(tmp_path, "one")
    write(tmp_path, "two", x0=20, width=60)
    (tmp_path / "noses.csv").write_text("picture,u_px,v_px\ntwo.png,21,105\n", encoding="utf-8")
    one, two = labelled_pictures(tmp_path)
    assert (one.width_px, two.width_px) == (40.0, 60.0)
    assert np.all(np.isnan(one.nose_px))
    # the part of the picture starts at its left border
    np.testing.assert_allclose(two.nose_px[0], 21.0)
    for target in (one, two):
        rows, columns = np.nonzero(target.cover)
        np.testing.assert_allclose([columns.mean(), rows.mean()], target.middle_px)
        assert np.all(target.image[target.cover > 0] < 40)


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    def refused(match: str) -> None:
        with pytest.raises(GroundstationError, match=match):
            labelled_pictures(tmp_path)

    refused("no pictures")
    write(tmp_path, "one")
    (tmp_path / "one.mask.png").rename(tmp_path / "kept.mask.png")
    refused(r"one\.mask\.png: got no picture")
    (tmp_path / "kept.mask.png").rename(tmp_path / "one.mask.png")
    (tmp_path / "noses.csv").write_text("picture,u_px,v_px\nthree.png,21,105\n", encoding="utf-8")
    refused(r"noses\.csv: got no picture three\.png")
    (tmp_path / "noses.csv").write_text("picture,u_px,v_px\none.png,left,105\n", encoding="utf-8")
    refused("line 2: got u_px = 'left'")
    (tmp_path / "noses.csv").unlink()
    cv2.imwrite(str(tmp_path / "one.mask.png"), np.zeros((240, 320), np.uint8))
    refused("an aircraft 0 px wide")
    cv2.imwrite(str(tmp_path / "one.mask.png"), np.zeros((24, 32), np.uint8))
    refused("32 × 24 px; wanted 320 × 240 px")
