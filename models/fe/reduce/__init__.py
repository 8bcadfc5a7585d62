"""From the full model to a fast body: touches, modes, integration points, indentation table."""
