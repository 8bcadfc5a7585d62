"""Derivatives of the results of a graph by its settings, from runs in parallel lanes (docs/backwards.md)."""
