"""Calibration by day: airliners whose ADS-B positions a receiver notes, and the Moon."""
