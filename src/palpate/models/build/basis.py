"""Builds the basis of a reduced finite-element body: presses the full model, condenses it and stores the result."""

import json
import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np

from palpate.compiler.trust import UntrustedError, make_folder, user_cache
from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.meshing.fingertip import FingertipDimensions
from palpate.models.fe.meshing.organ import Capsule, Nodule, Organ, edge_for
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce import reduction
from palpate.models.fe.reduce.reducible import of_finger, of_organ
from palpate.models.fe.reduce.reduction import errors
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import SURFACES
from palpate.nodes.deformation.basis_store import about, key, touches
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.physics.archive import replace_text
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hyperelastic import MIXED_FROM
from palpate.physics.writable import check_folder

INDEX = "index.json"  # index of the folder of shipped bases, whose files have readable names
MOST = 2500  # limit of vertices of a condensed surface; its dense compliance matrix then uses 0.5 GB
FEWEST = 100  # number of vertices from which the error of a basis is estimated with half as many
MOST_ELEMENTS = 18_000  # limit of elements of a sampled body; the selection of its points then uses 3 GB


Begin = Callable[..., Callable[[float], None]]
"""Begins a stage of a build with a name, a note, and None if its duration is unknown; returns a function that takes the
fraction done."""


def silent(name: str, note: str, total: float | None = 1.0) -> Report:
    """Show no progress."""
    return unheard


def estimate_time(node: ReducedFE, vertices: int) -> str:
    """Estimated processor time of a build, as text. Measured on a loaded core, with mesher and error: 20 s for 700
    vertices, 65 s for 1780. A sampled basis takes longer, because the full model is pressed."""
    seconds = 10.0 + 18.0 * (vertices / 1000) ** 2
    return "several minutes" if node.model == "sampled" else f"roughly {seconds:.0f} s of processor time"


def home(node: ReducedFE, folder: Path) -> Path:
    """Path of the basis of a node in a folder."""
    name = node.filename()
    return folder / (f"{name.rpartition('-')[0]}.npz" if (folder / INDEX).exists() else name)


def make(node: ReducedFE, path: Path, begin: Begin = silent, commit: str | None = None) -> dict[str, float]:
    """Build the basis of a node and store it atomically. Returns its errors [1] at held-out touches.

    SettingError: an unsupported surface or material, or a folder without write permission.
    """
    if node.surface == "fingertip" and node.model != "sampled":
        raise SettingError(
            f"model {node.model!r} with surface 'fingertip': expected 'sampled', because its layers stiffen by a "
            "factor of 100. Use --set model=sampled"
        )
    try:
        check_folder(path.parent)
        for folder in (path.parent, solutions_folder(node))[: 2 if node.model == "sampled" else 1]:
            if user_cache() in folder.parents:
                make_folder(folder)
    except UntrustedError as error:
        raise SettingError(f"folder {error.filename}: {error.strerror}") from None
    except OSError as error:
        raise SettingError(
            f"folder {path.parent}: {error.strerror}; expected a writable folder, such as -o bases"
        ) from None
    basis, missed = build_basis(node, begin)
    inputs = node.inputs()
    provenance = {
        "key": key(inputs), "inputs": inputs, "version": version("palpate"), "commit": commit,
        "command": node.command(), "error": {name: round(value, 5) for name, value in missed.items()},
    }  # fmt: skip
    basis.save(path, json.dumps(provenance))
    index = path.with_name(INDEX)
    if index.exists():
        entries = json.loads(index.read_text(encoding="utf-8")) | {path.name: about(path)}
        replace_text(index, json.dumps(entries, indent=1, sort_keys=True) + "\n")
    return missed


def solutions_folder(node: ReducedFE) -> Path:
    """Folder of the full solutions, from which an interrupted build resumes."""
    return touches() if node.surface == "fingertip" else touches() / node.key()


def build_basis(node: ReducedFE, begin: Begin, check: bool = True) -> tuple[Basis | SampledBasis, dict[str, float]]:
    """The basis and its errors [1] at held-out touches; {} without `check`.

    The error of the condensed basis of a file is estimated by the difference of its stiffness under a patch from that
    of a basis with half the vertices, since the error is inversely proportional to their number; x, y, z [m]: the
    worst place, in the surface's frame. {} for built-in surfaces.
    """
    if node.model == "sampled":
        return _sample_organ(node, begin, check)
    reduced, count = node.reduced_count(), len(node.coarse_mesh().vertices)
    basis = _condense_organ(node, begin, reduced)
    if node.surface in SURFACES or not check or count < FEWEST:
        return basis, {}
    half = _condense_organ(node, begin, (reduced or count) // 2, "half the vertices, for the error: ")
    stiffness, rough = node.stiffness_field(basis)[0], node.stiffness_field(half)[0]
    off = np.abs(rough / stiffness - 1.0)
    x, y, z = node.in_its_frame(node.mesh().vertices[int(np.argmax(off))])
    found = {"mean": float(off.mean()), "worst": float(off.max()), "vertices": len(basis.vertices)}
    return basis, found | {"x": x, "y": y, "z": z}


def _condense_organ(node: ReducedFE, begin: Begin, vertices: int | None, what: str = "") -> Basis:
    """The organ condensed to its surface; reduced to this number of vertices, None: as it is."""
    organ = of_organ(_organ(node, begin, vertices, what))
    condensing = begin("condensing", f"{what}{3 * len(organ.mesh.points)} degrees of freedom")
    compliance = organ.compliance(condensing)
    condensing(1.0)
    return Basis(organ.surface.vertices, organ.surface.triangles, compliance)


def _organ(node: ReducedFE, begin: Begin, vertices: int | None = None, what: str = "") -> Organ:
    surface = node.coarse_mesh()
    found = len(surface.vertices)
    if vertices is None:
        _check_size(node, surface)
    count = vertices or found
    reduced = f", reduced from {found}" if count < found else ""
    took = "" if what else f"; the build takes {estimate_time(node, count)}"
    meshed = begin("meshing", f"{what}the inside of {count} vertices{reduced}{took}", None)
    try:
        hard = node.nodule_radius > 0  # only then is the surface of all vertices needed, which may have to be refined
        region = node.region() if hard and node.nodule_shape else None
        nodule = Nodule(node.nodule_centre(), node.nodule_radius, node.nodule_ratio, region) if hard else Nodule()
        capsule = Capsule(node.capsule_thickness, node.capsule_ratio)
        edge = edge_for(surface, vertices) if vertices else 0.0
        bone = node.bone() if node.bone_shape else None
        organ = Organ(surface, node.poisson, node.bed, nodule, capsule, edge, node.near_walls(), bone)
    except MeshError as error:
        raise SettingError(f"surface {node.surface!r}: {error}") from None
    _check_size(node, organ.surface)
    meshed(1.0)
    return organ


def _check_size(node: ReducedFE, surface: Mesh) -> None:
    """SettingError: too many vertices to condense."""
    if len(surface.vertices) > MOST:
        raise SettingError(
            f"surface {node.surface!r}: {len(surface.vertices)} vertices, expected at most {MOST}, as the body stores "
            "a number for each pair of vertices. Set `coarse` to at most 2000"
        )


def _sample_organ(node: ReducedFE, begin: Begin, check: bool) -> tuple[SampledBasis, dict[str, float]]:
    """Press the full model and reduce it to modes; measure the errors at held-out touches."""
    finger = node.surface == "fingertip"
    body = (
        of_finger(FingertipDimensions(cells=reduction.CELLS))
        if finger
        else of_organ(_organ(node, begin, node.reduced_count()))
    )
    if len(body.mesh.elements) > MOST_ELEMENTS:
        raise SettingError(
            f"surface {node.surface!r}: {len(body.mesh.elements)} elements, expected at most {MOST_ELEMENTS} for model "
            "'sampled'. Reduce the vertices: set `coarse`, or coarsen a file in a mesh editor"
        )
    if any(law.mixed for law in body.materials(1.0).values()):
        raise SettingError(
            f"poisson {node.poisson} with model 'sampled': expected less than {MIXED_FROM}; above it, the points of "
            "an element share their pressure and cannot be sampled separately. Use model=nonlinear"
        )
    # solutions of the full model, and modes and integration points from them
    pressing = begin("pressing", f"{3 * len(body.mesh.points)} degrees of freedom")
    seen, held_out = reduction.full_solutions(body, finger, pressing, solutions_folder(node))
    if len(seen) < 2 or not held_out:
        raise SettingError(
            f"surface {node.surface!r}, bed {node.bed}: the full model converged for {len(seen) + len(held_out)} "
            "touches, too few for modes. A larger `bed` would support it"
        )
    sampling = begin("sampling", f"{node.modes} modes")
    basis = reduction.build(body, seen, held_out, node.modes, sampling)
    sampling(1.0)
    if not finger:  # 2 MB per touch; those of the fingertip serve any number of modes
        shutil.rmtree(solutions_folder(node), ignore_errors=True)
    if not check:
        return basis, {}
    # errors at touches that the basis was not built from
    checked = begin("checking", f"{reduction.UNSEEN} held-out touches")
    presses = reduction.unseen_solutions(body, finger, checked)
    if not any(len(other.solutions) for other in presses):
        return basis, {}
    sampled, linear = (abs(error) for error in errors(body, basis, presses))
    found = {"mean": sampled.mean(), "worst": sampled.max(), "linear_mean": linear.mean(), "linear_worst": linear.max()}
    return basis, {name: float(value) for name, value in found.items()}
