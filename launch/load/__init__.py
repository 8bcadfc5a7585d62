"""Loading, checking and planning of graphs, scenes, placements and launch files."""
