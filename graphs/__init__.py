"""Graphs, scenes and placements that ship with palpate."""
