"""Cameras that run: found and opened by URL, kept running, their frames stamped in the host's clock."""
