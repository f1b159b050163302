"""The entity tree of ``session.rrd``: paths, the timeline and the colours; docs/rerun.md shows it whole."""

from typing import NewType

import numpy as np
import rerun as rr

from groundstation.arrays import FloatArray
from groundstation.errors import InputError

Colour = NewType("Colour", tuple[int, int, int])

TIMELINE = "session_time"
# 64 bits of nanoseconds hold 292 years
MAX_TIME_S = 9.2e9
# the frame of docs/conventions.md that all entities are in, and what Rerun calls the frame of the entity /
RUNWAY_FRAME = "runway"
ROOT_FRAME = "tf#/"

# Rerun's quaternions end with w, ours begin with it
XYZW = [1, 2, 3, 0]

WORLD = "world"
RUNWAY = f"{WORLD}/runway"
STATIONS = f"{WORLD}/stations"
AIRCRAFT = "aircraft"
EKF = f"{AIRCRAFT}/ekf"
EKF_NAME = f"{EKF}/name"
EKF_PATH = f"{EKF}/path"
EKF_ELLIPSOID = f"{EKF}/ellipsoid"
EKF_ELLIPSOIDS = f"{EKF}/ellipsoids"
TRIANGULATION = f"{AIRCRAFT}/triangulation"
LOG = "log"
STATUS = "status"
TRACK_STATUS = f"{STATUS}/track"
ADVICE = f"{STATUS}/advice"
WORDS = "station/words"
PLOTS = "plots"
ERROR = f"{PLOTS}/error"
NIS = f"{PLOTS}/nis"
NIS_BOUNDS = f"{NIS}/bounds"
LATENCY = f"{PLOTS}/latency"
PAIR_LATENCY = f"{LATENCY}/pair"
PTU = f"{PLOTS}/ptu"
APPROACH = f"{PLOTS}/approach"
NEEDLES = f"{APPROACH}/needle"
CENTRE_LINE_NEEDLE = f"{NEEDLES}/centre_line"
GLIDE_PATH_NEEDLE = f"{NEEDLES}/glide_path"
THRESHOLD_HEIGHT = f"{APPROACH}/height"
TOUCHDOWN = f"{RUNWAY}/touchdown"

AXES = ("x", "y", "z")

EKF_COLOUR = Colour((90, 220, 255))
# colours are chosen for it; a viewer whose theme is light would show them on white
BACKGROUND = Colour((4, 6, 7))
# text in the scene has a box behind it: in the dark theme the background shows through, in the light theme a box of
# white at 43 % over it (read off pictures of both, Rerun 0.41 in a browser). White has 20:1 on one and 4.8:1 on the
# other; a colour has less, down to 1.5:1 for the runway's grey
LABEL_COLOUR = Colour((255, 255, 255))
# the filter's colour in the middle; lightness alone encodes the range, so that it is readable without colour vision
RANGE_SCALE_M = (0.0, 300.0, 600.0)
RANGE_COLOURS = (Colour((235, 252, 255)), EKF_COLOUR, Colour((40, 105, 235)))
COASTING_COLOUR = Colour((255, 190, 60))
TRIANGULATION_COLOUR = Colour((255, 120, 200))
DGPS_COLOUR = Colour((255, 225, 90))
SMOOTHED_COLOUR = Colour((245, 245, 245))
TRUTH_COLOUR = Colour((120, 195, 135))
BOUND_COLOUR = Colour((150, 150, 150))
REFUSED_COLOUR = Colour((255, 90, 80))
ROI_COLOUR = Colour((255, 225, 90))
CONTOUR_COLOUR = Colour((120, 230, 120))
TARGET_COLOUR = Colour((255, 60, 60))
CENTRE_LINE_COLOUR, GLIDE_PATH_COLOUR = Colour((255, 225, 90)), Colour((255, 120, 200))
TOUCHDOWN_COLOUR = Colour((120, 230, 120))
PREDICTION_COLOUR = EKF_COLOUR
STATION_COLOURS = (Colour((160, 145, 255)), Colour((255, 160, 90)), Colour((110, 215, 190)), Colour((225, 130, 150)))


def base(station: str) -> str:
    """Return the entity of the pose of a station's base."""
    return f"{STATIONS}/{station}/base"


def head(station: str) -> str:
    """Return the entity of the attitude of a station's head."""
    return f"{STATIONS}/{station}/head"


def camera(station: str) -> str:
    """Return the entity of a station's camera on its head, with its frustum."""
    return f"{STATIONS}/{station}/camera"


def frame(station: str, part: str) -> str:
    """Return the name of a station's frame: ``part`` is base, head or camera (docs/conventions.md), or image."""
    return f"{station}.{part}"


def image(station: str) -> str:
    """Return the entity of a station's picture; what is drawn over it lies below this path."""
    return f"cameras/{station}/image"


def station_colour(number: int) -> Colour:
    """Return the colour of the n-th station of the rig, in all views."""
    return STATION_COLOURS[number % len(STATION_COLOURS)]


def range_colour(range_m: float) -> Colour:
    """Return the filter's colour at a distance from the runway's origin: nearly white close by, deep blue far away.

    The scale is the same in every recording, so that runs can be compared.
    """
    r, g, b = (round(float(np.interp(range_m, RANGE_SCALE_M, [c[k] for c in RANGE_COLOURS]))) for k in range(3))
    return Colour((r, g, b))


def dimmed(colour: Colour) -> Colour:
    """Return a darker shade, for what belongs to a line and is not the line."""
    r, g, b = (int(0.55 * c) for c in colour)
    return Colour((r, g, b))


def time_column(t_s: FloatArray) -> rr.TimeColumn:
    """Return session times (n,) in s as the recording's index, rounded to whole ns.

    Raises `InputError` for times that 64 bits of ns do not hold.
    """
    latest_s = float(np.max(np.abs(t_s), initial=0.0))
    if latest_s > MAX_TIME_S:
        raise InputError("session time", got=f"{latest_s:g} s", wanted=f"at most {MAX_TIME_S:g} s")
    return rr.TimeColumn(TIMELINE, duration=np.round(np.asarray(t_s) * 1e9).astype("timedelta64[ns]"))
