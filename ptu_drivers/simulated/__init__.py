"""Simulated units of all protocols, on ptys and over HTTP."""
