"""Frames, rotations, lenses and pan-tilt stations; pure functions of numbers."""
