"""Rigs of several sources of calibration made one."""
