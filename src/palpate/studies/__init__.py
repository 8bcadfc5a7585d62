"""Studies of the models and the loop: accuracy, stability, tuning to a budget, sweeps and psychophysics."""
