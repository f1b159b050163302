"""Drawn days: airliners that pass two heads of unknown orientation, and what a receiver notes of them."""
