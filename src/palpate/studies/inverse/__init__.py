"""Parameters of a graph that explain recordings: the recorded motion drives the graph (docs/backwards.md)."""
