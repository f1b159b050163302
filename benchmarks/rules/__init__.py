"""Rules of search, detection and track management that a run can go without (`benchmarks/rule_ablation.py`)."""
