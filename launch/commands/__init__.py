"""The verbs of the command line, one file each; `launch/__main__.py` puts them together."""
