"""Approaches tracked through the whole pipeline at the level of pixels, for the studies of landings."""
