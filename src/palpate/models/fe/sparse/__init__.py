"""Sparse linear systems: pattern, ordering, factorization, assembly of the tangent."""
