"""Formulas: arrays in, arrays out. Imports only numpy, scipy and numba, so it can be used alone in a notebook."""
