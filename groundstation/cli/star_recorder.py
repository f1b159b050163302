"""Pictures of the sky for a calibration by stars: a head turned to each pointing, a picture saved with its angles."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from calibration.picture_table import PICTURE_COLUMNS, READINGS_COLUMN, TIME_COLUMN
from calibration.stars.pointing_plan import Pointing
from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.live.sighting_station import StandingPicture
from ptu_drivers.monitor import MoveResult, format_moved

# farther off than this, a move is told
_ARRIVED_RAD = float(np.radians(0.1))
COLUMNS = (*PICTURE_COLUMNS, TIME_COLUMN, READINGS_COLUMN, "pan_from", "tilt_from")
# of a picture: their mean is better than the encoder's noise, not than its step
READINGS = 25


class TurningCamera(Protocol):
    """A camera on a head, as `groundstation.live.sighting_station.SightingStation` is one."""

    @property
    def name(self) -> str:
        """The station's name."""
        ...

    def angles(self) -> FloatArray:
        """Return pan and tilt (2,), rad, as read now."""
        ...

    def turn_to(self, pan_rad: float, tilt_rad: float) -> tuple[MoveResult, ...]:
        """Turn the head to readings, rad, and wait until it stands."""
        ...

    def pictures(self, count: int, readings: int) -> Iterator[StandingPicture]:
        """Yield pictures of one stop."""
        ...


class PictureFolder:
    """The folder of a night's or a day's pictures; the table is whole after each of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._rows: list[str] = []
        if (folder / "pictures.csv").exists():
            wanted = "a new folder (--pictures); `--from` takes pictures that are there"
            raise InputError(str(folder), got="pictures of another night or day", wanted=wanted)

    @property
    def count(self) -> int:
        """How many pictures are in it."""
        return len(self._rows)

    def add(self, station: str, pointing: Pointing, taken: StandingPicture, readings: int = READINGS) -> str:
        """Save one picture and its row; returns the file's name. Raises `InputError` where it cannot be written."""
        name = f"{station}-{sum(row.split(',')[1] == station for row in self._rows):03d}.png"
        grey = taken.image if taken.image.ndim == 2 else cv2.cvtColor(taken.image, cv2.COLOR_BGR2GRAY)
        pan, tilt = np.degrees(taken.mean_rad).tolist()
        came = f"{pointing.pan_from},{pointing.tilt_from}"
        row = f"{name},{station},{pan:.6f},{tilt:.6f},{taken.t_s:.3f},{readings},{came}"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(self.folder / name, cv2.imencode(".png", grey)[1].tobytes())
            write_whole(self.folder / "pictures.csv", "\n".join([",".join(COLUMNS), *self._rows, row, ""]))
        except OSError as fault:
            raise InputError(str(self.folder), got=os_words(fault), wanted="a folder that can be written") from fault
        self._rows.append(row)
        return name


def take_pictures(
    station: TurningCamera, plan: Sequence[Pointing], night: PictureFolder, tell: Callable[[str], None]
) -> None:
    """Turn the head to each pointing from the side that it says, and save a picture there."""
    for number, pointing in enumerate(plan):
        turn_from_side(station, pointing, tell)
        taken = next(iter(station.pictures(1, READINGS)))
        name = night.add(station.name, pointing, taken)
        at = f"pan {pointing.pan_deg:g}, tilt {pointing.tilt_deg:g}"
        tell(f"{station.name}: {number + 1} of {len(plan)}, {at}: {name}")


def turn_from_side(station: TurningCamera, pointing: Pointing, tell: Callable[[str], None]) -> None:
    """Turn the head to a pointing from the side that it says."""
    for pan, tilt in (pointing.before_deg, (pointing.pan_deg, pointing.tilt_deg)):
        for moved in station.turn_to(float(np.radians(pan)), float(np.radians(tilt))):
            # lines of each move would hide the pictures' own
            if abs(moved.reached_rad - moved.wanted_rad) > _ARRIVED_RAD:
                tell(format_moved(moved))
