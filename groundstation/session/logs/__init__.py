"""Position logs as receivers and autopilots write them, read into fixes with time, place, quality and sigma."""
