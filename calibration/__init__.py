"""Calibration of stations: the code that finds what a rig file holds."""
