"""`palpate reduce`: build the basis of a reduced finite-element body and store it."""

import contextlib
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.launch.terminal.options import Json
from palpate.launch.terminal.output import console, say, tell
from palpate.physics.errors import TROUBLE

MOST_COARSE = 2000  # what the setting `coarse` takes at most
WORST = 0.25  # [1] error at the worst touch from which on a basis is of no use; those that ship have less


def reduce(
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", help="A setting of deformation.ReducedFE: surface=liver.stl, poisson=0.48, bed=30."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Build it even if it is already stored.")] = False,
    levels: Annotated[
        bool,
        typer.Option("--levels", help="Fit the fidelity levels of deformation.Adaptive to its stored basis instead."),
    ] = False,
    folder: Annotated[str | None, typer.Option("--to", help="Folder to store it in; by default the cache.")] = None,
    as_json: Json = False,
) -> None:
    """Build the basis of deformation.ReducedFE for a surface and a material, and store it in the cache."""
    from palpate.engine.provenance import commit
    from palpate.launch.load.values.overrides import settings_of
    from palpate.launch.terminal.progress import Stages
    from palpate.models.build import basis
    from palpate.nodes.deformation.basis_store import SHIPPED, cache
    from palpate.nodes.deformation.reduced_fe import ReducedFE

    if levels:
        _levels(settings_of(sets or []), force, as_json)
        return
    node = ReducedFE(**settings_of(sets or []))
    target = Path(folder) if folder else cache()
    path = basis.home(node, target)
    known = None if force else node.stored(SHIPPED, target)
    if known is not None:
        _say(as_json, known[0], None, {})
        return
    started = time.perf_counter()
    try:
        with Stages(console(stderr=True), as_json) as stages:
            missed = basis.make(node, path, stages, commit())
    except KeyboardInterrupt as error:
        again = "resumes after the touches already computed" if node.surface == "fingertip" else "starts again"
        error.add_note(f"nothing is stored; the same command {again}")
        raise
    _say(as_json, path, time.perf_counter() - started, missed)
    if missed.get("worst", 0.0) > WORST:
        finer = f"--set coarse={min(2 * node.coarse, MOST_COARSE)} (now {node.coarse}, by default {ReducedFE.coarse})"
        cure = f"more vertices in {node.surface}" if "." in node.surface else finer
        text = f"stored, but the error is above {WORST:.0%} at some touches. Use a finer surface: {cure}"
        typer.secho(text, fg="red", err=True)
        raise typer.Exit(TROUBLE)


def _levels(settings: dict[str, Any], force: bool, as_json: bool) -> None:
    from palpate.engine.provenance import commit
    from palpate.launch.terminal.progress import Stages
    from palpate.models.build.fidelity_levels import make
    from palpate.nodes.base import SettingError
    from palpate.nodes.deformation import Adaptive
    from palpate.nodes.deformation.adaptive import beside
    from palpate.nodes.deformation.basis_store import SHIPPED, cache

    node = Adaptive(**settings)
    stored = None if force else node.stored(SHIPPED, cache())
    if stored is not None and beside(stored[0]).exists():
        with contextlib.suppress(SettingError):  # levels of another basis are made anew
            node.levels()
            _say(as_json, beside(stored[0]), None, {})
            return
    with Stages(console(stderr=True), as_json) as stages:
        path, seen = make(node, stages, commit())
    if as_json:
        tell({"path": str(path), **seen})
    else:
        words = f"fitted to {seen['states']} states of {seen['touches']} touches"
        say(f"{words}: {path}")


def _say(as_json: bool, path: Path, seconds: float | None, missed: dict[str, float]) -> None:
    size = path.stat().st_size
    if as_json:
        stored = {"path": str(path), "bytes": size, "built": seconds is not None, "seconds": seconds}
        tell(stored | ({"unseen": missed} if missed else {}))
        return
    done = "stored already" if seconds is None else f"built in {seconds:.0f} s"
    say(f"{done}: {path} ({size / 1e6:.1f} MB)")
    if missed:
        linear = ""
        if "linear_mean" in missed:
            linear = f"; of the linear body {missed['linear_mean']:.1%}, {missed['linear_worst']:.1%}"
        say(
            f"error at touches that it was not built from: {missed['mean']:.1%} in the mean, "
            f"{missed['worst']:.1%} at worst{linear}"
        )
