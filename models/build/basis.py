"""The basis of a reduced finite-element body: the full model is pressed and condensed, and the result stored."""

import json
import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.meshing.fingertip import FingertipDimensions
from palpate.models.fe.meshing.organ import Capsule, Nodule, Organ
from palpate.models.fe.reduce import reduction
from palpate.models.fe.reduce.holdout import errors
from palpate.models.fe.reduce.reducible import of_finger, of_organ
from palpate.models.fe.reduce.snapshots import press, press_from_rest
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.basis_store import about, key, touches
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hyperelastic import MIXED_FROM
from palpate.physics.writable import check_folder

INDEX = "index.json"  # of a folder of bases that is shipped; there they have readable names
MOST = 2500  # Vertices of a surface that is condensed: with these the dense compliance takes half a gigabyte
MOST_ELEMENTS = 18_000  # Elements of a body that is sampled: what its points are chosen from takes three gigabytes


class Stages(Protocol):
    """Shows how far a build is."""

    def begin(self, name: str, note: str, total: float | None = 1.0) -> Callable[[float], None]:
        """A stage: called with the share of it that is done; `total` None where it cannot say."""


class Silent:
    """Shows nothing."""

    def begin(self, name: str, note: str, total: float | None = 1.0) -> Callable[[float], None]:
        return lambda share: None


def expected(node: ReducedFE, vertices: int) -> str:
    """How long a build takes on one idle core, for people: 12 s of processor time were measured for 300 vertices, 34 s
    for 602; a sampled one presses the full model as well."""
    seconds = 10.0 + 24.0 * (vertices / 602) ** 1.5
    return "several minutes" if node.model == "sampled" else f"roughly {seconds:.0f} s"


def home(node: ReducedFE, folder: Path) -> Path:
    """Where the basis of a node lies in a folder."""
    name = node.filename()
    return folder / (f"{name.rpartition('-')[0]}.npz" if (folder / INDEX).exists() else name)


def make(node: ReducedFE, path: Path, stages: Stages | None = None, commit: str | None = None) -> dict[str, float]:
    """Build the basis of a node, and store it whole or not at all. Its errors [1] where it was not made from.
    SettingError: a surface or a material that no basis can be made of, or a folder that cannot be written to."""
    if node.surface == "fingertip" and node.model != "sampled":
        raise SettingError(
            f"model {node.model!r} with surface 'fingertip': expected 'sampled', as its layers stiffen a hundredfold. "
            "Take --set model=sampled"
        )
    try:
        check_folder(path.parent)
    except OSError as error:
        raise SettingError(
            f"folder {path.parent}: {error.strerror}; expected one that can be written, such as -o bases"
        ) from None
    basis, missed = built(node, stages or Silent())
    inputs = node.inputs()
    provenance = {
        "key": key(inputs), "inputs": inputs, "version": version("palpate"), "commit": commit,
        "command": node.command(), "error": {name: round(value, 5) for name, value in missed.items()},
    }  # fmt: skip
    basis.save(path, json.dumps(provenance))
    index = path.with_name(INDEX)
    if index.exists():
        entries = json.loads(index.read_text(encoding="utf-8")) | {path.name: about(path)}
        index.write_text(json.dumps(entries, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return missed


def kept(node: ReducedFE) -> Path:
    """Folder of the full solutions that are kept while the basis of a node is built, so that the build can resume."""
    return touches() if node.surface == "fingertip" else touches() / node.key()


def built(node: ReducedFE, stages: Stages, check: bool = True) -> tuple[Basis | SampledBasis, dict[str, float]]:
    """The basis, and its errors [1] at touches that it was not made from; none of a condensed one, or without
    `check`."""
    if node.model == "sampled":
        return _sampled(node, stages, check)
    organ = of_organ(_organ(node, stages))
    condensing = stages.begin("condensing", f"{3 * len(organ.mesh.points)} degrees of freedom")
    compliance = organ.compliance(condensing)
    condensing(1.0)
    return Basis(organ.surface.vertices, organ.surface.triangles, compliance), {}


def _organ(node: ReducedFE, stages: Stages) -> Organ:
    surface = node.coarse_mesh()
    _check_size(node, surface)
    count = len(surface.vertices)
    meshed = stages.begin("meshing", f"the inside of {count} vertices; the build takes {expected(node, count)}", None)
    try:
        nodule = Nodule(node.nodule_centre(), node.nodule_radius, node.nodule_ratio)
        capsule = Capsule(node.capsule_thickness, node.capsule_ratio)
        organ = Organ(surface, node.poisson, node.bed, nodule, capsule)
    except MeshError as error:
        raise SettingError(f"surface {node.surface!r}: {error}") from None
    _check_size(node, organ.surface)
    meshed(1.0)
    return organ


def _check_size(node: ReducedFE, surface: Mesh) -> None:
    """SettingError: more vertices than can be condensed."""
    if len(surface.vertices) > MOST:
        raise SettingError(
            f"surface {node.surface!r}: {len(surface.vertices)} vertices, expected at most {MOST}, as the body keeps a "
            "number for each pair of them. Coarsen it in a mesh editor"
        )


def _sampled(node: ReducedFE, stages: Stages, check: bool) -> tuple[SampledBasis, dict[str, float]]:
    """Press the full model, reduce it to modes, and press it at other places: the basis and its error there."""
    finger = node.surface == "fingertip"
    body = of_finger(FingertipDimensions(cells=reduction.CELLS)) if finger else of_organ(_organ(node, stages))
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
    seen, held = (reduction.finger_pressed if finger else reduction.organ_pressed)(body, pressing, kept(node))
    if len(seen) < 2 or not held:
        raise SettingError(
            f"surface {node.surface!r}, bed {node.bed}: the full model converged for {len(seen) + len(held)} touches, "
            "too few for modes. A larger `bed` would support it"
        )
    sampling = stages.begin("sampling", f"{node.modes} modes")
    basis = reduction.build(body, seen, held, node.modes, sampling)
    sampling(1.0)
    if not finger:  # 2 MB a touch; those of the fingertip serve any number of modes
        shutil.rmtree(kept(node), ignore_errors=True)
    if not check:
        return basis, {}
    checked = stages.begin("checking", f"{reduction.UNSEEN} touches that it was not made from")
    others = (reduction.finger_touches if finger else reduction.organ_touches)(
        body, reduction.UNSEEN, reduction.UNSEEN_SEED
    )
    presses = (press if finger else press_from_rest)(body, others, checked)
    if not any(len(other.solutions) for other in presses):
        return basis, {}
    own, linear = (abs(miss) for miss in errors(body, basis, presses))
    found = {"mean": own.mean(), "worst": own.max(), "linear_mean": linear.mean(), "linear_worst": linear.max()}
    return basis, {name: float(value) for name, value in found.items()}
