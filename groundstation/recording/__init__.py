"""Recordings of runs in MCAP files: writer, reader, codecs of the messages, recovery (docs/formats.md)."""
