"""Deformable bodies, one step at a time."""
