"""The file format of a recording."""
