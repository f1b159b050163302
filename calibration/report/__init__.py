"""Pictures that the pages of all calibrations have in common."""
