"""The commands, one file each, in folders that are the groups of `palpate --help`.

The file `x.py`, in any folder here, defines the command `x` as the function `x`, and an `EXAMPLE` for its help. The
first paragraph of the function's docstring is its line in the list of commands. The docstring of a folder is the title
of its group in the help. A folder in a group is a command, and its files are its subcommands, as in `palpate list
nodes`; its docstring is its help.
"""

HELP = "What a fingertip feels on soft tissue: a graph of message-passing nodes."
ORDER = (
    "running", "run", "touch", "view", "top",
    "graphs", "check", "plan", "list", "new",
    "recordings", "info", "echo", "picture", "replay", "compare", "export",
    "cost", "bench", "tune", "rates",
    "fitting", "fit", "tissue", "record", "force", "body", "build", "basis", "fingertip", "fe", "table",
    "studies", "study", "experiment",
    "machine", "doctor", "devices", "remote", "keys", "join",
)  # fmt: skip
"""Order of folders and commands in the help; the others follow in alphabetical order."""
