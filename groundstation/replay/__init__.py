"""Replaying recorded sessions: load, run, compare, view."""
