"""The filter over aircraft and pan-tilt units: state, motion, measurements, predictors."""
