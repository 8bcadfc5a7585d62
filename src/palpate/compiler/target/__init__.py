"""The target of kernels: how numba compiles them, for which processor, and what is stored of their code."""
