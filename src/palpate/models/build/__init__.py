"""Builders of the bases of reduced bodies."""
