"""The measurement updates of the filter: each is a function of the predicted state and one measurement."""
