"""The group 'Recordings' of the help."""

PANEL = "Recordings"
ORDER = ("info", "echo", "picture", "replay", "compare", "export")
