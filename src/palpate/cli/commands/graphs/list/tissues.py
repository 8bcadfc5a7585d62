"""`palpate list tissues`: the published tissues."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, check_ending, out_option
from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table

EXAMPLE = "palpate list tissues liver-human"


def tissues(
    name: Annotated[str | None, typer.Argument(help="Show this tissue in full.")] = None,
    out: Annotated[Path | None, out_option("Picture of its force next to those of the same organ (.png).")] = None,
    as_json: Json = False,
) -> None:
    """List published tissues, or show one with its source.

    A scene takes one by its name, `tissue: liver-human`.
    """
    if out is not None:
        _draw_tissue(name, out, as_json)
        return
    from palpate.engine.faults import NOWHERE
    from palpate.launch.load.tissues import GRADES, bodies, settings
    from palpate.launch.load.tissues import tissues as known

    taken = None if name is None else settings(name, NOWHERE)  # a misspelt name fails before `known` compiles kernels
    found, left_out = known()
    # One tissue in full.
    if name is not None and taken is not None:
        record = {**found[name], "scene": taken, "bodies": bodies(found[name])}
        if as_json:
            print_json({"ok": True, "tissues": {name: record}})
        else:
            from palpate.launch.load.classes import find_class
            from palpate.nodes.base import settings as settings_of

            bodies_of = [
                settings_of(find_class(f"deformation.{body}")) for body in ("MassSpring", "BeamBundle", "ReducedFE")
            ]
            units = {key: one.unit for known in bodies_of for key, one in known.items()}
            numbers = {key: f"{_format_value(value)} {units[key]}".removesuffix(" 1") for key, value in taken.items()}
            record |= {"grade": GRADES[found[name]["grade"]], "scene": numbers}
            console().print(table(("", ""), [(key, _format_value(value)) for key, value in record.items()]))
        return
    # All tissues as a table.
    if as_json:
        print_json(
            {"ok": True, "tissues": {k: {**v, "bodies": bodies(v)} for k, v in found.items()}, "left_out": left_out}
        )
        return
    rows = [
        (key, str(r["shear"]), str(r["law"]), GRADES[r["grade"]], str(r["rate"]).replace("not read", ""))
        for key, r in found.items()
    ]
    heads = ("tissue", ">shear", "law", "number is", "rate")
    console().print(table(heads, rows, fixed=heads[:4]))
    say(
        "MassSpring, BeamBundle and ReducedFE take the modulus at rest; full finite elements take law and relaxation.",
        wrap=True,
    )
    say("\nLeft out:", style="bold")
    for key, why in left_out.items():
        say(f"{key}: {why}", wrap=True)
    say("palpate list tissues NAME shows one with its source; palpate run kidney --set scene.tissue=NAME", wrap=True)


def _draw_tissue(name: str | None, out: Path, as_json: bool) -> None:
    from palpate.views.pictures.models.tissues import draw_tissues

    if name is None:
        raise typer.BadParameter("needs the NAME of a tissue, such as kidney-assumed", param_hint="--out")
    check_ending(out)
    drawn = draw_if_possible(draw_tissues, name, out)
    if as_json:
        print_json({"ok": True, "pictures": [str(path) for path in drawn]})
    else:
        for path in drawn:
            say(path)


def _format_value(value: object) -> str:
    if isinstance(value, dict):
        return "\n".join(f"{key}: {_format_value(part)}" for key, part in value.items())
    if isinstance(value, list):
        return f"[{', '.join(map(_format_value, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
