"""Checks of the values of a graph: settings that agree, organs that lie in each other."""
