"""Contact of organs with each other."""
