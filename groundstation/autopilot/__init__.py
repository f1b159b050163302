"""MAVLink to an aircraft's autopilot: position and velocity with covariance, in time, or silence."""
