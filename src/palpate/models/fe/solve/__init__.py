"""Static equilibrium: assembly, Newton iteration with load steps, checkpoints."""
