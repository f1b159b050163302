"""The rig's errors from a flight whose aircraft had a reference receiver."""
