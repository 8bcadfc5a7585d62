"""`palpate fit body`: calibrate MassSpring or BeamBundle to a reference body under the scene's patch."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.output import print_json, say
from palpate.cli.terminal.run_options import RunOptions, takes_run
from palpate.launch.run.progress import steps

EXAMPLE = "palpate fit body kidney"
PER_TICK = 1e-3  # [s] computing time per tick of the touch, for a body and its reference


@takes_run()
def body(
    chosen: RunOptions,
    reference: Annotated[
        list[str] | None,
        typer.Option(help="Settings of the reference, as for --set; default: ReducedFE instead of the body."),
    ] = None,
    duration: options.Duration = None,
    out: Annotated[Path | None, options.out_option("Launch file to write; default runs/GRAPH-fitted.yaml.")] = None,
    as_json: options.Json = False,
) -> None:
    """Fit MassSpring or BeamBundle to a reference body.

    Fits the model's constants to the force and indentation of the reference on the touch of the graph, writes a launch
    file, and prints the differences in force, indentation and shape before and after the fit.
    """
    from palpate.studies import fit_body as study

    launch = chosen.launch(silent=as_json).but(duration=duration)
    launch.load()
    file = options.launch_file(launch, out, "fitted")
    length = launch.duration or 0.0
    expected = 5e3 * PER_TICK * length
    with steps(f"fit body: a touch of {length:g} s", 3, silent=as_json, seconds=expected, timed=False) as done:
        fitted = study.fit_body(launch, file, reference or [], done)
    if as_json:
        print_json({"ok": True, "file": str(file), "set": fitted.overrides, "before": fitted.before,
                    "after": fitted.after, "caution": fitted.caution})  # fmt: skip
        return
    for key, value in fitted.overrides.items():
        say(f"{key} = {value}", wrap=True)
    say("Differences from the reference, RMS of its peak:", wrap=True)
    for word, off in (("before", fitted.before), ("after", fitted.after)):
        say(f"{word:7} {study.words(off)}", wrap=True)
    say(fitted.reference, wrap=True)
    if fitted.caution:
        say(fitted.caution, "yellow", wrap=True)
    say(f"written {file}: palpate run {file}", wrap=True)
