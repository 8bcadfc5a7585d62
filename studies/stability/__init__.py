"""How stiff a wall or a body may be on a device: theory, and the simulated loop."""
