"""Tactile shape displays: the deformation of a fingerpad, and the pins that render it."""
