"""Conversion to sessions: from videos and a log (`import`), between a folder and a recording (`convert`)."""
