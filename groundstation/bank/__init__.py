"""The bank: many drawn worlds, replayed and scored, so that generalisation is a measured figure."""
