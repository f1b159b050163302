"""The papers' experiments on this project's recordings: `groundstation reproduce`."""
