"""Poses of stations from landmarks, and the check whether they are still valid."""
