"""The commands, one file each, in folders that are the groups of `palpate --help`.

The file `x.py`, in any folder here, defines the command `x` as the function `x`, and an `EXAMPLE` for its help. The
first paragraph of the function's docstring is its line in the list of commands. A folder with a `HELP` is a command,
and its files are its subcommands, as in `palpate list nodes`. A folder with a `PANEL` is a group of the help. `ORDER`
is the order of files and folders in the help; the others follow in alphabetical order.
"""

HELP = "What a fingertip feels on soft tissue: a graph of message-passing nodes."
ORDER = ("running", "graphs", "recordings", "cost", "fitting", "studies", "machine")
