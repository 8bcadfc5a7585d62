"""A rigid organ that fingers move on its foundation."""
