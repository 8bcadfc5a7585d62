"""Run the full finite-element models."""
