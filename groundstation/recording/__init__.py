"""The container of what a run consumed and answered: MCAP, docs/formats.md says what is in it."""
