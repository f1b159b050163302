"""Rendered approaches to a runway as the nose camera sees them, with exact truth (docs/onboard.md)."""
