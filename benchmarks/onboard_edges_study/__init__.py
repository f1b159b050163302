"""Parts of benchmarks/onboard_edges.py."""
