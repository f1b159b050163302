"""What a stop's rows say of it: one that scatters is left out."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.landmarks.mark_pictures import MarkPictures
from calibration.landmarks.sighting_table import SightingTable
from calibration.sightings import Landmark
from groundstation.arrays import FloatArray
from groundstation.cli.sighting_recorder import SightingRecorder, StopSettings
from groundstation.errors import GroundstationError
from groundstation.live.sighting_station import StandingPicture
from tests.calibration.landmarks.sighting_set_up import SIZE, mark_px, scene, true_rig

_COUNT = 8


class _Stop:
    """In place of a station: pictures whose scene (n, 2) px and angles (n, 2) rad move as stated."""

    def __init__(self, moved_px: FloatArray, angles_rad: FloatArray) -> None:
        self.calibrated = true_rig()["left"]
        self.name, self.turns, self.senses = "left", True, (1, 1)
        self._moved_px, self._angles_rad = moved_px, angles_rad

    def pictures(self, count: int, _: int) -> Iterator[StandingPicture]:
        """Yield the first pictures of the stop."""
        mark = mark_px(self.calibrated)
        for k, angles in enumerate(self._angles_rad[:count]):
            image = scene(self._moved_px[k], mark)
            yield StandingPicture(t_s=float(k), image=image, angles_rad=angles, mean_rad=angles)


@pytest.mark.parametrize(
    ("pixel_px", "angle_deg", "words"),
    [(0.2, 0.002, ""), (3.0, 0.002, "pixels scattered by"), (0.2, 0.02, "angles scattered by")],
)
def test_a_stop_that_scatters_is_left_out(tmp_path: Path, pixel_px: float, angle_deg: float, words: str) -> None:
    """Expected: a head's noise is saved; more of pixels or of angles is told with a wish to repeat, and not saved."""
    rng = np.random.default_rng(5)
    moved = rng.normal(0.0, pixel_px, (_COUNT, 2))
    moved[0] = 0.0
    station = _Stop(moved, rng.normal(0.1, np.radians(angle_deg), (_COUNT, 2)))
    landmarks = {"mast": Landmark(name="mast", kind="direction", place=None, sigma=np.zeros(3))}
    out, told = tmp_path / "sightings.csv", list[str]()
    recorder = SightingRecorder(
        station,  # type: ignore[arg-type]
        landmarks,
        SightingTable(out),
        MarkPictures(tmp_path / "pictures", "left", SIZE, landmarks),
        StopSettings(pictures=_COUNT, readings=1, picked_sigma_px=0.3),
        told.append,
    )
    if not words:
        recorder.record_picked("mast", mark_px(station.calibrated))
        assert (recorder.stops, recorder.rows_of("mast")) == (1, _COUNT)
        return
    with pytest.raises(GroundstationError, match=rf"^mast: left out, repeat it .*: got {words} .* over 8 pictures"):
        recorder.record_picked("mast", mark_px(station.calibrated))
    assert (recorder.stops, recorder.rows_of("mast"), out.exists()) == (0, 0, False)
    assert not recorder.knows("mast")
    assert cv2.imread(str(tmp_path / "pictures" / "left" / "marks" / "mast.png")) is None
