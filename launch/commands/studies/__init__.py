"""Searches and benchmarks."""
