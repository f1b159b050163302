"""A picture that a head took while it stood: its station, angles and time, whatever is seen in it."""

from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from calibration.picture_table import ListedPicture
from groundstation.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadPicture:
    """One picture.

    Attributes
    ----------
    label : for the user. station : the station's name.
    reading_rad : (2,) pan and tilt as read; ``sense`` (2,) the last direction of motion of each.
    utc_s : Unix time of the mid-exposure.
    readings : how many readings the angles are the mean of.
    """

    label: str
    station: str
    reading_rad: FloatArray
    sense: FloatArray
    utc_s: float
    readings: int = 1


class PictureFields(TypedDict):
    """What a `HeadPicture` is made of."""

    label: str
    station: str
    reading_rad: FloatArray
    sense: FloatArray
    utc_s: float
    readings: int


def listed_fields(item: ListedPicture) -> PictureFields:
    """Return what a row of pictures.csv says of its picture."""
    return {
        "label": item.file,
        "station": item.station,
        "reading_rad": np.radians(item.reading_deg),
        "sense": np.array(item.sense, dtype=np.float64),
        "utc_s": item.utc_s,
        "readings": item.readings,
    }
