"""What a worker does: its life, its nodes, and the loops on each clock."""
