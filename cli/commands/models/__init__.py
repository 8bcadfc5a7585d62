"""Off-line computations: bases, fits, fingers, finite elements."""
