"""Sinks of reports: tables, overlay video, comparison with recorded outputs."""
