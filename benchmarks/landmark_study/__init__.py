"""Simulated mornings at an airstrip: landmarks observed by stations that deviate slightly from their rig."""
