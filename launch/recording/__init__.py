"""Recordings: reading, drawing, replaying, comparing, exporting."""
