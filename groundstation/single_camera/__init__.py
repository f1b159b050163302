"""Tracking in one video of one camera."""
