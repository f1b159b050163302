"""Heads calibrated by the stars: pictures solved, stars identified, lens, mount and axes fitted together."""
