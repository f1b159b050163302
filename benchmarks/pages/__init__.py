"""What `benchmarks/regenerate_pages.py` writes into README and docs: outputs, figures, tables and pictures."""
