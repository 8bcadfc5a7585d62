"""Spread a run over several machines: keys and workers."""
