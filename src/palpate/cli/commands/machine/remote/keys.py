"""`palpate remote keys`: the keys that secure connections to other machines."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import print_json, say

EXAMPLE = "palpate remote keys --make"


def keys(
    name: Annotated[str | None, typer.Argument(help="Key to list; with --make, key to make (default: rig).")] = None,
    make: Annotated[bool, typer.Option("--make", help="Make a new key.")] = False,
    as_json: Json = False,
) -> None:
    """List the keys of this user, or make one.

    Anyone who has a key file can take part in the runs that it secures. Copy it to the same place on every machine
    of a rig, and keep it secret.
    """
    from palpate.launch.run.wire import keys as known

    made = known.make(known.NAME if name is None else name) if make else None
    if name is not None:
        known.load(name)
    paths = {path.stem: path for path in sorted(known.folder().glob("*.json")) if name in (None, path.stem)}
    if as_json:
        print_json(
            {"ok": True, "made": None if made is None else str(made), "keys": {n: str(p) for n, p in paths.items()}}
        )
        return
    if made is not None:
        say(f"made {made}; copy it to the same place on the other machines", "green")
    for key_name, path in paths.items():
        say(f"{key_name}  {path}")
    if not paths:
        say(f"no keys in {known.folder()}; `palpate remote keys --make` makes one", "dim")
