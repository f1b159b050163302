"""Pose relative to a runway from its corners, and an inertial filter that it aids (docs/onboard-pose.md)."""
