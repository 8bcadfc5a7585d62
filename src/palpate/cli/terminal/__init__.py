"""Shared by the commands: options, printing, progress, errors without traceback."""
