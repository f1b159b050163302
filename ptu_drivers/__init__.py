"""Drivers for serial pan-tilt units, usable without the rest."""
