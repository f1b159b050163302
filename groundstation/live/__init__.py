"""The station in operation: devices in threads, one pipeline, what is said to heads, disk and operator."""
