"""`palpate list effects`: the catalogue of effects."""

from typing import Any

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json, table

EXAMPLE = "palpate list effects"


def effects(as_json: Json = False) -> None:
    """List the effects: nodes that compute and fields that show each."""
    from palpate.launch.load.effects import list_effects

    rows = [_row(name, parts) for name, parts in list_effects().items()]
    if as_json:
        print_json({"effects": rows})
    else:
        cells = ((row["effect"], "\n".join(row["computed_by"]), ", ".join(row["shown_by"])) for row in rows)
        console().print(table(("effect", "computed by", "shown by"), cells))


def _row(name: str, parts: list[Any]) -> dict[str, Any]:
    about = next((effect.about for _, effect in parts if effect.about and effect.how == "part"), "")
    return {
        "effect": name,
        "about": about,
        "computed_by": sorted({use + (f", {effect.setting}" if effect.setting else "") for use, effect in parts}),
        "shown_by": sorted({field for _, effect in parts for field in effect.fields}),
    }
