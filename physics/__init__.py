"""Formulas: arrays in, arrays out. Imports numpy, scipy and numba only; usable from a notebook on its own."""

from palpate.physics import arithmetic, kernel_cache

# Before numpy and the first kernel: whoever imports palpate first gets the same bits on every machine.
arithmetic.pin()
kernel_cache.use()
