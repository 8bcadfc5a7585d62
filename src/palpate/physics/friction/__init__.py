"""Friction with bristles and without."""
