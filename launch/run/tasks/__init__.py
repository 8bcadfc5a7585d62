"""Tasks for other processes: items of a study or an ensemble, computed in blocks on any executor."""
