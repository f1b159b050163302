"""Looking at a recorded session with several detectors side by side, against the exact truth."""
