"""Simulated mornings at an airstrip: landmarks seen through stations that are not quite what their rig says."""
