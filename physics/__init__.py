"""Formulas: arrays in, arrays out. Imports numpy, scipy and numba only; usable from a notebook on its own."""
