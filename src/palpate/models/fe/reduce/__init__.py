"""Model order reduction: touches of the full model, modes, integration points."""
