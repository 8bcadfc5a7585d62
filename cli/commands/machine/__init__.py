"""The group 'Machine' of the help."""

PANEL = "Machine"
ORDER = ("doctor", "devices", "remote")
