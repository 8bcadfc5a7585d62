"""Fit a force model, a material or a body to data."""
