"""Tactile shape displays: what a pad feels, and the pins that show it."""
