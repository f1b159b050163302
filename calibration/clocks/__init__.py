"""The clocks of cameras and pan-tilt units, from one motion that both have seen."""
