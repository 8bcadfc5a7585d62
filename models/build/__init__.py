"""Builders of what the reduced bodies read: bases."""
