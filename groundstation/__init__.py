"""Groundstation: where is the approaching aircraft, in 3-D, from two cameras on pan-tilt units."""

__version__ = "0.1.0"
