"""Offline finite elements for soft layered bodies: the reference solution for the fast models.

Each material law of `palpate.physics.materials` is available by its name: `neo_hooke(20e3, 0.48)`.
"""

from collections.abc import Callable

from palpate.models.fe.contact.pair import Pair
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.contact.rigid import RigidIndenter, capsule, plane, sphere
from palpate.models.fe.element.mesh import MeshError, TetMesh, box, quadratic
from palpate.models.fe.solve.solver import ConvergenceError, Settings, Solver
from palpate.physics.materials.hyperelastic import Material, MaterialError, constructor, laws

__all__ = [
    "ConvergenceError", "ElasticFoundation", "Material", "MaterialError", "MeshError", "Pair", "RigidIndenter",
    "Settings", "Solver", "TetMesh", "box", "capsule", "plane", "quadratic", "sphere",
]  # fmt: skip


def __getattr__(name: str) -> Callable[..., Material]:
    if name.startswith("_"):
        raise AttributeError(name)
    return constructor(name)


def __dir__() -> list[str]:
    return sorted([*__all__, *laws()])
