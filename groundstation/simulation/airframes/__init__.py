"""Shapes of aircraft: closed triangles with colours, of one known trainer or of parametric families drawn at random."""
