"""What benchmarks/filter_study.py and the filter's statistical tests share: flights, runs over them, bounds."""
