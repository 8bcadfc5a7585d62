"""`palpate fit texture RECORDING.csv`: autoregressive models of a surface, for texture.Autoregressive."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Dialect, Force, Json, check_new, out_option
from palpate.cli.terminal.output import console, print_json, say, table
from palpate.physics.archive import replace_text

EXAMPLE = "palpate fit texture stroke.csv -o wood.json"


def texture(
    file: Annotated[Path, typer.Argument(help="CSV: t,speed,normal and lateral or acceleration, in SI units.")],
    held_out: Annotated[float | None, typer.Option(help="Speed to predict, in m/s; default: a middle one.")] = None,
    out: Annotated[Path | None, out_option("File to write; by default RECORDING.json.")] = None,
    dialect: Dialect = "",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fit a texture to a recording of strokes at several speeds and forces.

    Prints the vibration of each model with its 95 % interval, and the error in third-octave bands at a speed that was
    held out. `palpate run texture --set texture.use=texture.Autoregressive --set texture.model=FILE` renders it.
    """
    import msgspec

    from palpate.models.fit.texture import ENOUGH, WINDOW, fit_texture

    target = out or file.with_suffix(".json")
    check_new([target], force)
    notes: list[str] = []
    fitted = fit_texture(file, held_out, notes, dialect)
    replace_text(target, msgspec.json.format(msgspec.json.encode(fitted)).decode() + "\n")
    if as_json:
        print_json({"ok": True, "file": str(target), **msgspec.to_builtins(fitted), "notes": notes})
        return
    for text in notes:
        say(f"{file.name}: {text}", wrap=True)
    unit = "N" if fitted.quantity == "force" else "m/s^2"
    rows = [(f"{1e3 * m.speed:.4g}", f"{m.force:.3g}", f"{m.rms:.4g}",
             "{:.4g} to {:.4g}".format(*m.interval) if m.interval else "withheld")
            for m in fitted.models]  # fmt: skip
    console().print(table((">speed [mm/s]", ">force [N]", f">rms [{unit}]", ">95 % interval"), rows))
    if any(m.interval is None for m in fitted.models):
        say(f"interval withheld: fewer than {ENOUGH} steady windows of {WINDOW:g} s do not show how the gain wanders; "
            "record longer at each speed and force", "yellow", wrap=True)  # fmt: skip
    say(f"order {len(fitted.models[0].lsf)}, {fitted.sampling:g} Hz: written {target}", wrap=True)
    if fitted.held_out is None:
        say("no speed was held out: models at three speeds and more are needed", "yellow")
        return
    speed, errors = fitted.held_out
    shown = ", ".join(f"{frequency:g} Hz {error:+.1f}" for frequency, error in errors)
    say(f"held out, {1e3 * speed:.4g} mm/s: error in third-octave bands [dB]: {shown}", wrap=True)
