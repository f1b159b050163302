"""The papers' experiments on our recordings: `groundstation reproduce`."""
