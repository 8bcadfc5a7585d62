"""Builders of what the reduced bodies read: bases, and the levels of one that keeps to an error."""
