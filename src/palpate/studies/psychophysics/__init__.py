"""Psychophysical experiments: a stimulus is a run of a graph; a trial is one row of a table with its recordings."""
