"""`palpate reduce`: build the basis of a reduced finite-element body and store it."""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import INTERRUPTED, TROUBLE, Json, console, tell

if TYPE_CHECKING:
    from pathlib import Path

    from palpate.launch.commands.stages import Stages
    from palpate.models.fe.meshing.organ import Organ
    from palpate.nodes.deformation.reduced_fe import ReducedFE
    from palpate.physics.bodies.sampled_body import SampledBasis
    from palpate.physics.geometry.mesh import Mesh

INDEX = "index.json"
"""Of a folder of bases that is shipped; there they have readable names."""
MOST = 2500
"""Vertices of a surface that is condensed: with these the dense compliance takes half a gigabyte."""

MOST_COARSE = 2000
"""What the setting `coarse` takes at most."""

WORST = 0.25
"""[1] Error at the worst touch from which on a basis is of no use; those that ship have less."""

MOST_ELEMENTS = 18_000
"""Elements of a body that is sampled: what its points are chosen from takes three gigabytes."""


def reduce(
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", help="A setting of deformation.ReducedFE: surface=liver.stl, poisson=0.48, bed=30."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Build it even if it is stored.")] = False,
    folder: Annotated[str | None, typer.Option("--to", help="Folder to store it in; by default the cache.")] = None,
    as_json: Json = False,
) -> None:
    """Build the basis of deformation.ReducedFE for a surface and a material, and store it in the cache."""
    from pathlib import Path

    from palpate.nodes.base import SettingError
    from palpate.nodes.deformation.basis_store import SHIPPED, cache
    from palpate.nodes.deformation.reduced_fe import ReducedFE

    node = ReducedFE(**_given(sets or []))
    if node.surface == "fingertip" and node.model != "sampled":
        raise SettingError(
            f"model {node.model!r} with surface 'fingertip': expected 'sampled', as its layers stiffen a hundredfold. "
            "Take --set model=sampled"
        )
    target = Path(folder) if folder else cache()
    path = target / (_shipped_name(node) if (target / INDEX).exists() else node.filename())
    known = None if force else node.stored(SHIPPED, target)
    if known is not None:
        _say(as_json, str(known[0]), None)
        return
    _check_writable(target)
    started = time.perf_counter()
    try:
        missed = _build(node, path, as_json)
    except KeyboardInterrupt:
        again = "goes on from the touches that were pressed" if node.surface == "fingertip" else "begins anew"
        typer.secho(f"stopped: nothing is stored; the same command {again}", fg="red", err=True)
        raise typer.Exit(INTERRUPTED) from None
    finally:
        path.with_name(f"{path.name}.part.npz").unlink(missing_ok=True)
    _enter(path)
    _say(as_json, str(path), time.perf_counter() - started, missed)
    if missed.get("worst", 0.0) > WORST:
        finer = f"--set coarse={min(2 * node.coarse, MOST_COARSE)} (now {node.coarse}, by default {ReducedFE.coarse})"
        cure = f"more vertices in {node.surface}" if "." in node.surface else finer
        text = f"stored, but off by more than {WORST:.0%} at some touches. A finer surface mends it: {cure}"
        typer.secho(text, fg="red", err=True)
        raise typer.Exit(TROUBLE)


def _given(sets: list[str]) -> dict[str, Any]:
    """Values by name of the texts "name=value". SettingError: another text, or a value that is no YAML."""
    import yaml

    from palpate.nodes.base import SettingError

    settings = {}
    for text in sets:
        name, sign, value = text.partition("=")
        if not sign:
            raise SettingError(f"--set {text}: expected name=value")
        try:
            settings[name.removeprefix("tissue.")] = yaml.safe_load(value)
        except yaml.YAMLError:
            raise SettingError(f"--set {text}: expected a number, a name or a list such as '[0, 0, 0.012]'") from None
    return settings


def _check_writable(folder: Path) -> None:
    """SettingError: nothing can be written there. Said before the minutes that a basis takes."""
    import tempfile

    from palpate.nodes.base import SettingError

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise SettingError(
            f"folder {folder}: {error.strerror}; expected one that can be written, such as --to bases"
        ) from None


def _build(node: ReducedFE, path: Path, quiet: bool) -> dict[str, float]:
    """Press and condense the full model, and write its basis, whole or not at all; what was found of its error."""
    import numpy as np

    from palpate.launch.commands.stages import Stages
    from palpate.models.fe.reduce.dents import LEVELS, PLACES, UNSEEN, dent_table, unseen
    from palpate.models.fe.reduce.reducible import of_organ
    from palpate.physics.bodies.condensed_body import Basis

    missed: dict[str, float] = {}
    with Stages(console(stderr=True), quiet) as stages:
        if node.model == "sampled":
            basis, missed = _sampled(node, stages)
            basis.save(path, _about(node, missed))
            return missed
        organ = of_organ(_organ(node, stages))
        condensing = stages.begin("condensing", f"{3 * len(organ.mesh.points)} degrees of freedom")
        compliance = organ.compliance(condensing)
        condensing(1.0)
        dents = np.zeros((len(organ.surface.vertices), 0))
        if node.model == "nonlinear":
            pressing = stages.begin("pressing", f"{PLACES} places, {LEVELS} indentations")
            dents = dent_table(organ, report=pressing)
            pressing(1.0)
            checked = stages.begin("checking", f"{UNSEEN} places that it was not made from", None)
            off = np.abs(unseen(organ, dents))
            checked(1.0)
            missed = {"mean": float(np.nanmean(off)), "worst": float(np.nanmax(off))}
    Basis(organ.surface.vertices, organ.surface.triangles, compliance, dents).save(path, _about(node, missed))
    return missed


def _about(node: ReducedFE, missed: dict[str, float]) -> str:
    """What a basis says of itself, as JSON."""
    import json

    from palpate.engine.provenance import commit
    from palpate.nodes.deformation.basis_store import key

    inputs = node.inputs()
    provenance = {
        "key": key(inputs),
        "inputs": inputs,
        "version": version("palpate"),
        "commit": commit(),
        "command": node.command(),
        "error": {name: round(value, 5) for name, value in missed.items()},
    }
    return json.dumps(provenance)


def _shipped_name(node: ReducedFE) -> str:
    """Of the file in a folder with an index."""
    return f"{node.filename().rpartition('-')[0]}.npz"


def _enter(path: Path) -> None:
    """Say in the index of the folder, if it has one, what the basis was made from."""
    import json

    from palpate.nodes.deformation.basis_store import about

    index = path.with_name(INDEX)
    if index.exists():
        entries = json.loads(index.read_text(encoding="utf-8")) | {path.name: about(path)}
        index.write_text(json.dumps(entries, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _organ(node: ReducedFE, stages: Stages) -> Organ:
    """The full model of the node's organ. SettingError: a surface that it cannot be made of."""
    from palpate.models.fe.element.mesh import MeshError
    from palpate.models.fe.meshing.organ import Capsule, Nodule, Organ
    from palpate.nodes.base import SettingError

    surface = node.coarse_mesh()
    _check_size(node, surface)
    meshed = stages.begin("meshing", f"the inside of {len(surface.vertices)} vertices", None)
    try:
        nodule = Nodule(node.nodule_centre, node.nodule_radius, node.nodule_ratio)
        capsule = Capsule(node.capsule_thickness, node.capsule_ratio)
        organ = Organ(surface, node.poisson, node.bed, nodule, capsule)
    except MeshError as error:
        raise SettingError(f"surface {node.surface!r}: {error}") from None
    _check_size(node, organ.surface)
    meshed(1.0)
    return organ


def _check_size(node: ReducedFE, surface: Mesh) -> None:
    """SettingError: more vertices than can be condensed."""
    from palpate.nodes.base import SettingError

    if len(surface.vertices) > MOST:
        raise SettingError(
            f"surface {node.surface!r}: {len(surface.vertices)} vertices, expected at most {MOST}, as the body keeps a "
            "number for each pair of them. Coarsen it in a mesh editor"
        )


def _sampled(node: ReducedFE, stages: Stages) -> tuple[SampledBasis, dict[str, float]]:
    """Press the full model, reduce it to modes, and press it at other places: the basis and its error there."""
    from palpate.models.fe.meshing.fingertip import Fingertip
    from palpate.models.fe.reduce.holdout import errors
    from palpate.models.fe.reduce.reducible import of_finger, of_organ
    from palpate.models.fe.reduce.reduction import (
        CELLS,
        UNSEEN,
        UNSEEN_SEED,
        build,
        finger_pressed,
        finger_touches,
        organ_pressed,
        organ_touches,
    )
    from palpate.models.fe.reduce.snapshots import press, press_from_rest
    from palpate.nodes.base import SettingError
    from palpate.nodes.deformation.basis_store import touches
    from palpate.physics.materials.hyperelastic import MIXED_FROM

    finger = node.surface == "fingertip"
    body = of_finger(Fingertip(cells=CELLS)) if finger else of_organ(_organ(node, stages))
    if len(body.mesh.elements) > MOST_ELEMENTS:
        raise SettingError(
            f"surface {node.surface!r}: {len(body.mesh.elements)} elements, expected at most {MOST_ELEMENTS} for model "
            "'sampled'. Fewer vertices make fewer: set `coarse`, or coarsen a file in a mesh editor"
        )
    if any(law.mixed for law in body.materials(1.0).values()):
        raise SettingError(
            f"poisson {node.poisson} with model 'sampled': expected less than {MIXED_FROM}: from there on the points "
            "of an element share their pressure and cannot be sampled one by one. Take model=nonlinear"
        )
    pressing = stages.begin("pressing", f"{3 * len(body.mesh.points)} degrees of freedom")
    seen, held = finger_pressed(body, pressing, touches()) if finger else organ_pressed(body, pressing)
    if len(seen) < 2 or not held:
        raise SettingError(
            f"surface {node.surface!r}, bed {node.bed}: the full model converged for {len(seen) + len(held)} touches, "
            "too few for modes. A larger `bed` would support it"
        )
    sampling = stages.begin("sampling", f"{node.modes} modes")
    basis = build(body, seen, held, node.modes, sampling)
    sampling(1.0)
    checked = stages.begin("checking", f"{UNSEEN} touches that it was not made from")
    others = (finger_touches if finger else organ_touches)(body, UNSEEN, UNSEEN_SEED)
    presses = (press if finger else press_from_rest)(body, others, checked)
    if not any(len(other.solutions) for other in presses):
        return basis, {}
    own, linear = (abs(miss) for miss in errors(body, basis, presses))
    return basis, {
        "mean": float(own.mean()),
        "worst": float(own.max()),
        "linear_mean": float(linear.mean()),
        "linear_worst": float(linear.max()),
    }


def _say(as_json: bool, path: str, seconds: float | None, missed: dict[str, float] | None = None) -> None:
    from pathlib import Path

    size = Path(path).stat().st_size
    if as_json:
        built = {"path": path, "bytes": size, "built": seconds is not None, "seconds": seconds}
        tell({**built, "unseen": missed} if missed else built)
    elif seconds is None:
        console().print(f"stored already: {path} ({size / 1e6:.1f} MB)", soft_wrap=True)
    else:
        console().print(f"built in {seconds:.0f} s: {path} ({size / 1e6:.1f} MB)", soft_wrap=True)
    if missed and not as_json:
        linear = ""
        if "linear_mean" in missed:
            linear = f"; the linear body by {missed['linear_mean']:.1%}, {missed['linear_worst']:.1%}"
        console().print(
            f"at touches that it was not made from it is off by {missed['mean']:.1%} in the mean, "
            f"{missed['worst']:.1%} at worst{linear}",
            soft_wrap=True,
        )
