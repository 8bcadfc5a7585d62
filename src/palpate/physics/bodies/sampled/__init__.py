"""A sampled body's step in parts: energy, equilibrium, the answer of one contact, and of several."""
