"""What makes kernels of formulas: the target, its cache, records, memory and pinned functions."""
