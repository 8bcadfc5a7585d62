"""Several organs of a scene's key `organs:`, and the lines of a graph that are repeated for each of them."""
