"""`palpate compare`: one recorded touch, computed with several variants."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.options import File, Json, NoPictures, Trust, check_ending, out_option
from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table
from palpate.launch.run.progress import ticks

if TYPE_CHECKING:
    from palpate.records.compare import Variant

EXAMPLE = "palpate compare runs/kidney.mcap --set tissue.use=deformation.ReducedFE"


def compare(
    file: File,
    sets: Annotated[list[str] | None, typer.Option("--set", help="Variant with one new value: tissue.use=...")] = None,
    variants: Annotated[
        list[str] | None, typer.Option("--variant", help="Variant with several new values, in quotes.")
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help='"recorded" or changed values; default: the first of several variants.')
    ] = None,
    organ: options.OrganOption = None,
    unit: options.UnitOption = None,
    piece: options.PieceOption = None,
    label: options.LabelOption = None,
    repair: options.RepairOption = False,
    out: Annotated[Path | None, out_option("PNG; FILE-compare.png if left out.")] = None,
    no_pictures: NoPictures = False,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Compute a recorded touch with several variants of its graph.

    Prints differences in force, indentation and shape, and step times. A single variant is compared with the graph as
    it was recorded. With --organ all variants, but not a given reference, are computed on the organ of a mesh file.
    """
    import shlex

    from palpate.records.changed import organ_overrides
    from palpate.records.compare import RECORDED
    from palpate.records.compare import compare as work
    from palpate.records.reader import Recording
    from palpate.records.stored import report_damage
    from palpate.views.pictures.models.compare import draw_comparison

    wanted = [[given] for given in sets or []] + [shlex.split(given) for given in variants or []]
    wanted = [[] if given == [RECORDED] else given for given in wanted]
    replaced, notes = options.organ_file(organ, unit, piece, repair, silent=as_json, label=label)
    if replaced is not None and not wanted:
        wanted = [[]]
    if not wanted:
        raise typer.BadParameter("expected --set or --variant, such as --set tissue.use=deformation.ReducedFE")
    base = None if reference is None else [] if reference == RECORDED else shlex.split(reference)
    if base is None and len(wanted) == 1:
        base = []
    target = out or file.with_name(f"{file.stem}-compare.png")
    if not no_pictures:
        check_ending(target)
    recording = Recording(file)
    if replaced is not None and not as_json:
        for line in (*notes, organ_overrides(recording, replaced)[1]):
            say(line, err=True)
    with report_damage(file), ticks("computing", silent=as_json) as show:
        outcomes = work(recording, wanted, reference=base, organ=replaced, show=show)
    paths = [] if no_pictures else draw_if_possible(draw_comparison, outcomes, target)
    if as_json:
        print_json({"ok": True, "complete": recording.complete, "ending": recording.ending,
                    "reference": outcomes[0].name,
                    "variants": [variant.report() for variant in outcomes],
                    "picture": str(*paths) or None})  # fmt: skip
        return
    _print(outcomes)
    if recording.ending:
        say(recording.ending, "yellow")
    for path in paths:
        say(f"picture {path}", wrap=True)


def _print(variants: list[Variant]) -> None:
    from rich.text import Text

    from palpate.studies.model_error import error_sentence

    out = console()
    names = [chr(ord("A") + i) if i < 26 else str(i) for i in range(len(variants))]
    for name, variant in zip(names, variants, strict=True):
        changed = f", changes {', '.join(variant.swapped)}" if variant.swapped else ""
        out.print(Text.assemble((name, "bold"), f"  {variant.name}{changed}"))
    heads = ("", ">force\n[N]\nrms", ">\n\npeak", ">indent.\n[mm]\nrms", ">\n\npeak", ">shape\n[mm]\nrms", ">\n\npeak",
             ">step\n[us]\np50", ">\n\np99", ">all\n[us]\np50", ">\n\np99")  # fmt: skip
    rows = []
    for name, variant in zip(names, variants, strict=True):
        force, depth, shape = (s.report() for s in (variant.force, variant.indentation, variant.shape))
        step, whole = variant.step.report(), variant.whole.report()
        rows.append((
            name, *(f"{force[k]:.4f}" for k in ("rms", "peak")),
            *(f"{s[k] * 1e3:.4f}" for s in (depth, shape) for k in ("rms", "peak")),
            *(f"{s[k] * 1e6:.1f}" for s in (step, whole) for k in ("p50", "p99")),
        ))  # fmt: skip
    out.print(table(heads, rows))
    for name, variant in zip(names, variants, strict=True):
        for note in variant.notes:
            say(f"{name}: {note}", "yellow", wrap=True)
    first = variants[0]
    say(
        f"Differences from A, whose peaks are {first.force.scale:.3f} N (force on the hand: normal and lateral), "
        f"{first.indentation.scale * 1e3:.3f} mm and {first.shape.scale * 1e3:.3f} mm. "
        f"{error_sentence(first.plan.graph)} step: the changed nodes (of A, or else the body); all: one tick.",
        wrap=True,
    )
