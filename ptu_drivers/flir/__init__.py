"""FLIR / Directed Perception pan-tilt units over their ASCII protocol."""
