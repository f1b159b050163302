"""How autopilots receive a position over MAVLink: which samples they take, why not the others, and for which time."""
