"""What a site will reach, before anyone drives out: accuracy over range from lens, baseline and calibration."""
