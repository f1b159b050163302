"""A lens that is possible but seldom meant is noted; one that is as usual is not."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.rig.rig_notes import rig_notes
from tests.stereo_rig import make_rig


@pytest.mark.parametrize(
    ("middle", "focal", "words"),
    [
        ([639.5, 479.5], [6684.0, 6650.0], None),
        ([900.0, -20.0], [6684.0, 6650.0], None),
        (
            [6.8, -8.6],
            [6684.0, 6650.0],
            "left: principal_point_px 6.8, -8.6 is at the upper left corner of the picture",
        ),
        ([639.5, 479.5], [6684.0, 3342.0], "left: focal_px 6684, 3342: pixels 2.00 times as long"),
    ],
)
def test_an_unusual_lens_is_noted(middle: list[float], focal: list[float], words: str | None) -> None:
    rig = make_rig()
    left, *others = rig.stations
    lens = replace(left.lens, principal_point_px=np.array(middle), focal_px=np.array(focal))
    notes = rig_notes(replace(rig, stations=(replace(left, lens=lens), *others)))
    assert len(notes) == (words is not None)
    assert all(words is not None and words in note for note in notes)
