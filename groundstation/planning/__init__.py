"""Site planning: expected accuracy over range from lens, baseline and calibration."""
