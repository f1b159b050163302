"""Simulated nights: heads with errors look at the catalogue's stars through air, clouds and a noisy camera."""
