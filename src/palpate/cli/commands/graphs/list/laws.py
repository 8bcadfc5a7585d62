"""`palpate list laws`: the material laws."""

from inspect import signature

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import print_json, say, write

EXAMPLE = "palpate list laws"


def laws(as_json: Json = False) -> None:
    """List the material laws: equation, and moduli at small strain."""
    from palpate.physics.materials.hyperelastic import constructor, example, rest_moduli
    from palpate.physics.materials.hyperelastic import laws as every

    rows = []
    for name, module in every().items():
        shear, bulk = rest_moduli(example(name))
        made = f"{name}{signature(constructor(name))}".split(" ->")[0].replace(": 'float'", "")
        text = (module.__doc__ or "").strip()
        rows.append({"law": name, "make": made, "example": list(module.EXAMPLE), "shear Pa": shear, "bulk Pa": bulk}
                    | {"text": text})  # fmt: skip
    if as_json:
        print_json({"ok": True, "laws": rows})
        return
    for row in rows:
        say(row["make"], "bold")
        write(f"{row['text']}\n\nat rest with {row['example']}: shear modulus {row['shear Pa']:.4g} Pa, bulk "
                   f"modulus {row['bulk Pa']:.4g} Pa\n")  # fmt: skip
