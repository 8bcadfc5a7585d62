"""Psychophysical experiments: stimuli are runs of a graph, answers a table with one row a trial, each with its recording."""
