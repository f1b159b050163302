"""The calibrated rig: each station's place, mount, lens and clocks with their covariance, and its file."""
