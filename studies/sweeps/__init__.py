"""Studies: one graph at many points, computed by Dask on any number of processes or machines."""
