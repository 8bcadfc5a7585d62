"""Studies: one graph at many points, computed by processes of this machine."""
