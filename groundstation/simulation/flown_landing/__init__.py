"""Landings flown by a plain autopilot with JSBSim's aircraft, on the true state or on the stream to the autopilot."""
