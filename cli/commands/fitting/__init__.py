"""The group 'Fit and build' of the help."""

PANEL = "Fit and build"
ORDER = ("fit", "build")
