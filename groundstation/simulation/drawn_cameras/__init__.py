"""Cameras drawn at random: sensor, lens, exposure and how their pictures are kept."""

from groundstation.simulation.drawn_cameras.camera_draw import draw_camera
from groundstation.simulation.drawn_cameras.camera_spec import CameraSpec

__all__ = ["CameraSpec", "draw_camera"]
