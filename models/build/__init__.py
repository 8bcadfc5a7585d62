"""Builders of what the reduced bodies read: bases, and the rungs of one that keeps to an error."""
