"""Units in which times are stored by mistake, where a session wants seconds."""

# each in seconds
TIME_UNITS_S = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
