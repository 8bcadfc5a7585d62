"""Pictures of fits and of scanned fingertips."""
