"""Two Dynamixel servos as a pan-tilt unit."""
