"""The landing site: runway, planned approach and alert limits, and its file."""
