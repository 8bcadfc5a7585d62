"""Stiffest wall or body that a device can render: theory and the simulated loop."""
