"""`palpate build basis`: build the basis of a reduced finite-element body and store it."""

import time
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, say
from palpate.physics.errors import TROUBLE

EXAMPLE = "palpate build basis --set surface=liver.stl --set young=5e3"
MOST_COARSE = 2000  # upper limit of the setting `coarse`
WORST = 0.25  # [1] error at the worst touch above which a basis is unusable; shipped bases stay below it


def basis(
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", help="A setting of deformation.ReducedFE: surface=liver.stl, poisson=0.48, bed=30."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Build it even if it is already stored.")] = False,
    out: Annotated[Path | None, out_option("Folder to store it in; by default the cache.")] = None,
    as_json: Json = False,
) -> None:
    """Build and store the basis of a ReducedFE body."""
    from palpate.engine.provenance import commit
    from palpate.launch.load.values.overrides import settings_of
    from palpate.launch.run.progress import StageBars
    from palpate.models.build import basis as builder
    from palpate.nodes.deformation.basis_store import SHIPPED, cache
    from palpate.nodes.deformation.reduced_fe import ReducedFE

    node = ReducedFE(**settings_of(sets or []))
    target = out or cache()
    path = builder.home(node, target)
    known = None if force else node.find_stored(SHIPPED, target)
    if known is not None:
        _print(as_json, known[0], None, {})
        return
    started = time.perf_counter()
    try:
        with StageBars(as_json) as stages:
            errors = builder.make(node, path, stages.begin, commit())
    except KeyboardInterrupt as error:
        again = "resumes after the touches already computed" if node.model == "sampled" else "starts again"
        error.add_note(f"nothing is stored; the same command {again}")
        raise
    _print(as_json, path, time.perf_counter() - started, errors)
    if errors.get("mean" if "vertices" in errors else "worst", 0.0) > WORST:
        finer = f"--set coarse={min(2 * node.coarse, MOST_COARSE)} (now {node.coarse}, by default {ReducedFE.coarse})"
        sampled = node.model == "sampled" and node.reduced_count() is None
        cure = f"more vertices in {node.surface}" if "." in node.surface and sampled else finer
        text = f"stored, but the error is above {WORST:.0%} at some touches. Use a finer surface: {cure}"
        say(text, "red", err=True)
        raise typer.Exit(TROUBLE)


def _print(as_json: bool, path: Path, seconds: float | None, errors: dict[str, float]) -> None:
    size = path.stat().st_size
    if as_json:
        stored = {"path": str(path), "bytes": size, "built": seconds is not None, "seconds": seconds}
        print_json(stored | ({"unseen": errors} if errors else {}))
        return
    done = "stored already" if seconds is None else f"built in {seconds:.0f} s"
    say(f"{done}: {path} ({size / 1e6:.1f} MB)")
    if errors:
        linear = ""
        if "linear_mean" in errors:
            linear = f"; of the linear body {errors['linear_mean']:.1%}, {errors['linear_worst']:.1%}"
        what = "estimated error of the stiffness under a patch, from half as many vertices"
        what = what if "vertices" in errors else "error at touches outside the training set"
        say(f"{what}: mean {errors['mean']:.1%}, worst {errors['worst']:.1%}{linear}")
