"""What a scale between a head's readings and the pictures' angles says of units and focal length."""

import math

# scale of an encoder, or of a focal length as a maker states it: 0.5 % and 1 % are usual
_MOST = 0.03
# a camera that is bolted to a head is rolled by less
_MOST_ROLL_DEG = 5.0
_TOLERANCE = 0.01
# by what a reading in that unit has to be multiplied to be in degrees
_UNITS_DEG = {"gradians": 0.9, "radians": math.degrees(1.0), "thousandths of a degree": 1e-3}


def scale_doubt(scale: float) -> str:
    """Return why a scale (angle over reading, less 1) is not that of a head; "" where it may be."""
    if abs(scale) <= _MOST:
        return ""
    words = f"angles are {1.0 + scale:.4g} times the readings, more than errors of heads and lenses are: "
    for unit, factor in _UNITS_DEG.items():
        if abs((1.0 + scale) / factor - 1.0) <= _TOLERANCE:
            return f"{words}are the readings in {unit}?"
    return f"{words}is the focal length right, and are the readings in degrees?"


def roll_doubt(roll_deg: float) -> str:
    """Return why a camera's roll against its head is doubtful; "" where it is not."""
    if abs(roll_deg) <= _MOST_ROLL_DEG:
        return ""
    return f"the camera is rolled by {roll_deg:+.1f} deg against the head's axes: are pan and tilt exchanged?"
