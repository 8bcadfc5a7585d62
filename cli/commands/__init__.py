"""The commands, one file each, in folders by what they are about.

The file `x.py`, in any folder here, holds the function `x`, which is the command `x`; a class `Command` in it takes the
place of typer's own. A folder with a `HELP` is a command itself and its files are the commands below it, as in
`palpate fe laws`. The help lists the commands in the order of `ORDER`, then those that it does not name.
"""

HELP = "What a fingertip feels on soft tissue: a graph of message-passing nodes."
ORDER = (
    "run", "touch", "check", "replay", "compare", "info", "echo", "top", "export", "recover", "plan", "rates", "nodes",
    "messages", "effects", "tissues", "pictures", "plot", "picture", "film", "view", "doctor", "devices", "reduce",
    "fit", "fit_tissue", "record_indentation", "join", "keys", "fingertip", "tune", "fit_body", "study",
    "experiment", "new", "fe", "bench",
)  # fmt: skip
