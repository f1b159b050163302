"""Where stations stand and look, from landmarks; and whether that still holds."""
