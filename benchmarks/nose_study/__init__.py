"""Parts of benchmarks/nose_approaches.py."""
