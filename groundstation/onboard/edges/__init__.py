"""Runway edges in the nose camera's pictures by region competition, tracked by a Kalman filter (docs/onboard.md)."""
