"""`palpate new`: files to begin from."""

HELP = "Write templates of files."
