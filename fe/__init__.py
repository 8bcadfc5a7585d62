"""Finite elements for soft layered bodies, off-line: the reference that the fast models are measured against."""

from palpate.fe.materials import Material, MaterialError, hencky, linear, mooney_rivlin, neo_hooke
from palpate.fe.mesh import MeshError, TetMesh, box, quadratic
from palpate.fe.meshed import meshed
from palpate.fe.pair import Pair
from palpate.fe.rigid import Rigid, capsule, plane, sphere
from palpate.fe.solver import ConvergenceError, Settings, Solver

__all__ = [
    "ConvergenceError",
    "Material",
    "MaterialError",
    "MeshError",
    "Pair",
    "Rigid",
    "Settings",
    "Solver",
    "TetMesh",
    "box",
    "capsule",
    "hencky",
    "linear",
    "meshed",
    "mooney_rivlin",
    "neo_hooke",
    "plane",
    "quadratic",
    "sphere",
]
