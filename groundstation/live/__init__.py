"""The station in operation: devices in threads, one pipeline, and the outputs to heads, disk and operator."""
