"""Workers: start and end, nodes, and the loop of each clock."""
