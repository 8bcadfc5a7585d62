"""Solvers that others wrote, each behind one adapter: studies and benchmarks hold ours against them."""
