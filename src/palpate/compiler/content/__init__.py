"""What the compiled code of a kernel depends on, as a hash: the name of its file in the cache."""
