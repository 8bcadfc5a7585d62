"""Errors of tactile and force sensors."""
