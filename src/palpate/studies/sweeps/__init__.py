"""Parameter studies: one graph at many points, computed in parallel on this machine."""
