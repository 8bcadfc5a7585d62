"""Places of the block whose static curves are references: solved by two solvers, each on two meshes, and stored.

    value = mean of both solvers' finer meshes
    band  = |difference of these| + the greater of both  |finer - coarser| / ((h/h')² - 1)

The last is Richardson's estimate with second order, which is below the order that smooth parts of the solution have.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from palpate.nodes.deformation import basis_store
from palpate.physics.archive import replacing
from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy import kidney
from palpate.studies.accuracy.kidney import Kidney
from palpate.studies.peers import MissingError, calculix, continuum, felupe, mujoco
from palpate.studies.peers.continuum import LEVELS, LIGHT, RADIUS, Block, ContinuumCurve, Inclusion

SHIPPED = Path(__file__).parent / "references"
MESHES = {"fe": (3, 5), "felupe": (2, 3)}
"""Cells across the patch's radius, coarser and finer, of each solver."""
SOLVERS: dict[str, Callable[..., ContinuumCurve]] = {
    "fe": continuum.press,
    "felupe": felupe.press,
    "calculix": calculix.press,
    "mujoco": mujoco.press,
    "mujoco-own": partial(mujoco.press, material="Saint Venant-Kirchhoff"),
}
"""Those of `MESHES` make the references; the others are held against them."""
ON_KIDNEY: dict[str, Callable[..., ContinuumCurve]] = {"fe": kidney.press, "felupe": kidney.press_felupe}
"""Those that press the kidney."""
PRESSING = (continuum, felupe, calculix, mujoco, kidney)
"""Modules that make curves."""
NEAR = 2.0 * RADIUS
"""[m] Round the place within which shapes are compared."""
PLACES: dict[str, Block | Kidney] = {
    "middle": Block(0.0),
    "slip": Block(0.0, sticks=False),
    "edge": Block(0.04),
    **{f"nodule-{mm:02d}": Block(1e-3 * mm, nodule=Inclusion()) for mm in (0, 10)},
    **{f"kidney{mm:+03d}": Kidney(1e-3 * mm) for mm in (-12, 0, 12)},
}
"""[m] `slip` is the middle, free to slide under the patch; `edge` is 10 mm from the border of the block; `nodule-NN` is
NN mm beside a nodule; `kidney+NN` is NN mm from the middle of the kidney's top towards its upper pole."""
PATHS = {"kidney": ("kidney-12", "kidney+00", "kidney+12")}
"""Places between which a touch moves, where its curve changes on the way."""


def on_path(name: str) -> tuple[str, ...]:
    """The places of a touch's reference: those of its path, or the one of this name."""
    return PATHS.get(name, (name,))


def cells_text(cells: int) -> str:
    """So many cells across the patch's radius, in words."""
    return f"{cells} cell{'' if cells == 1 else 's'} a radius"


def cache() -> Path:
    """Folder of what has been computed on this machine."""
    return basis_store.cache().with_name("bench")


@dataclass(frozen=True)
class ReferenceSite:
    """A stored reference.

    force, indentation, work  [N], [m], [J] (L,);  band [m] (L,) of the indentation
    x, y, shape               as of `Curve`;  shape_band [m] (L,) rms within `NEAR` of the place; none of a kidney
    about                     provenance
    """

    force: np.ndarray
    indentation: np.ndarray
    work: np.ndarray
    band: np.ndarray
    x: np.ndarray
    y: np.ndarray
    shape: np.ndarray
    shape_band: np.ndarray
    about: dict[str, Any]


@lru_cache(maxsize=32)
def stored(name: str) -> ReferenceSite:
    """The reference of this name. MissingError: it is not stored; ArgumentError: its file is damaged."""
    path = SHIPPED / f"{name}.npz"
    if not path.is_file():
        raise MissingError(
            f"{path}: no such reference. Build it: palpate bench accuracy --rebuild-references. "
            f"There are {', '.join(sorted(p.stem for p in SHIPPED.glob('*.npz'))) or 'none'}"
        )
    try:
        with np.load(path) as file:
            own = {f.name: file[f.name] for f in fields(ReferenceSite) if f.name != "about"}
            return ReferenceSite(**own, about=json.loads(str(file["about"])))
    except (OSError, KeyError, ValueError, EOFError) as error:
        raise ArgumentError(
            f"{path}: damaged ({error}). Build it anew: palpate bench accuracy --rebuild-references"
        ) from None


def rebuild(
    names: list[str], provenance: dict[str, Any], folder: Path = SHIPPED, meshes: dict[str, tuple[int, int]] = MESHES
) -> Iterator[tuple[str, float]]:
    """Compute the references of these names anew and store them; yields the name and the share done.

    What was computed on this machine with the same sources before is taken up, so that a run that was ended goes on.
    """
    todo = [(name, solver, cells) for name in names for solver in meshes for cells in meshes[solver]]
    curves_of: dict[tuple[str, str, int], ContinuumCurve] = {}
    for done, (name, solver, cells) in enumerate(todo):
        yield f"{name}: {solver}, {cells_text(cells)}", done / len(todo)
        curves_of[name, solver, cells] = computed(replace(PLACES[name], cells=cells), solver)
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        curves = {solver: [curves_of[name, solver, cells] for cells in meshes[solver]] for solver in meshes}
        place = combined(PLACES[name], curves, meshes)
        about = {
            **provenance,
            "place": asdict(PLACES[name]),
            "solvers": {
                solver: {"cells a radius": meshes[solver], "unknowns": [c.unknowns for c in own],
                         "indentation": [c.indentation.tolist() for c in own]}
                for solver, own in curves.items()
            },
            "young": continuum.YOUNG, "poisson": continuum.POISSON, "bed": continuum.BED, "radius": RADIUS,
            "felupe": felupe.version(),
        }  # fmt: skip
        numbers = {f.name: getattr(place, f.name) for f in fields(ReferenceSite) if f.name != "about"}
        numbers["shape"] = place.shape.astype(np.float32)
        np.savez_compressed(folder / f"{name}.npz", **numbers, about=np.array(json.dumps(about)))
    stored.cache_clear()
    yield "stored", 1.0


def computed(block: Block | Kidney, solver: str) -> ContinuumCurve:
    """The curve of a solver, computed or taken from what was computed before with the same sources."""
    levels = LEVELS if isinstance(block, Kidney) or block.sticks else LIGHT
    told = f"{solver} {block} {levels.tolist()} {_sources()}"
    path = cache() / "curves" / f"{hashlib.sha256(told.encode()).hexdigest()[:20]}.npz"
    if path.is_file():
        with np.load(path) as file:
            own = {f.name: file[f.name] for f in fields(ContinuumCurve)}
        return ContinuumCurve(**{**own, "unknowns": int(own["unknowns"])})
    curve = ON_KIDNEY[solver](block) if isinstance(block, Kidney) else SOLVERS[solver](block, levels)
    with replacing(path) as part:
        np.savez(part, **{f.name: getattr(curve, f.name) for f in fields(ContinuumCurve)})
    return curve


def combined(
    block: Block | Kidney, curves: dict[str, list[ContinuumCurve]], meshes: dict[str, tuple[int, int]]
) -> ReferenceSite:
    """The reference from each solver's curves on its coarser and finer mesh."""
    fine = {solver: own[-1] for solver, own in curves.items()}
    base = fine["fe"]
    rest = {
        solver: 1.0 / ((meshes[solver][1] / meshes[solver][0]) ** 2 - 1.0) if len(own) > 1 else 1.0
        for solver, own in curves.items()
    }
    depth = np.mean([c.indentation for c in fine.values()], axis=0)
    apart = np.ptp([c.indentation for c in fine.values()], axis=0)
    left = np.max([rest[s] * np.abs(own[-1].indentation - own[0].indentation) for s, own in curves.items()], axis=0)
    work = np.mean([c.work for c in fine.values()], axis=0)
    numbers = (base.force, depth, work, apart + left, base.x, base.y)
    if not len(base.x):
        return ReferenceSite(*numbers, base.shape, np.zeros_like(depth), {})
    shapes = {s: [_carried(c, base) for c in own] for s, own in curves.items()}
    shape = np.mean([own[-1] for own in shapes.values()], axis=0)
    x, y = np.meshgrid(base.x, base.y, indexing="ij")
    near = np.hypot(x - block.place, y) < NEAR

    def rms(difference: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt((difference[:, near] ** 2).mean(axis=1)))

    last = [own[-1] for own in shapes.values()]
    own_left = np.max([rest[s] * rms(own[-1] - own[0]) for s, own in shapes.items()], axis=0)
    shape_band = rms(last[0] - last[-1]) + own_left
    return ReferenceSite(*numbers, shape, shape_band, {})


def _carried(curve: ContinuumCurve, base: ContinuumCurve) -> np.ndarray:
    """The shape of a curve at the lines of another (L,x,y)."""
    if len(curve.x) == len(base.x) and np.allclose(curve.x, base.x) and len(curve.y) == len(base.y):
        return curve.shape
    at = np.stack(np.meshgrid(base.x, base.y, indexing="ij"), axis=-1)
    return np.array([RegularGridInterpolator((curve.x, curve.y), s, method="cubic")(at) for s in curve.shape])


@lru_cache(maxsize=1)
def _sources() -> str:
    """A hash of what a curve depends on."""
    text = b"".join(Path(str(module.__file__)).read_bytes() for module in PRESSING)
    from palpate.physics.kernel_cache import key

    versions = f"{felupe.version()} {calculix.version()} {mujoco.version()}"
    return hashlib.sha256(text + (key() + versions).encode()).hexdigest()
