"""What the pages of all calibrations have in common."""
