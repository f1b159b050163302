"""Calibration of stations: estimation of the contents of a rig file."""
