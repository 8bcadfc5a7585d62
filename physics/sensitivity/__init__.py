"""Derivatives of the contact force by parameters, carried along with the state (docs/equations/sensitivity.md)."""
