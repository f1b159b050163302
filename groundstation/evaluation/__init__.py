"""Comparison with a reference, physical bounds and the figures that go into reports."""
