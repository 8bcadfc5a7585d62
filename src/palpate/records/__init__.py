"""Recordings: their file format, reading, replay, check, comparison, repair, export."""
