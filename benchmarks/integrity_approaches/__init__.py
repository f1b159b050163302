"""Simulated approaches with faults, for benchmarks/integrity_study.py."""
