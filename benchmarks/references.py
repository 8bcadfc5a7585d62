"""Recompute the references of `palpate bench accuracy` with two solvers, each on two meshes.

    python benchmarks/references.py [PLACE ...]     # for example middle kidney+00; all, without a name: 40 minutes

    value = mean of both solvers' finer meshes
    band  = |difference of these| + the greater of both  |finer - coarser| / ((h/h')² - 1)

The last term is Richardson's error estimate with second order, a lower bound of the order in smooth parts of the
solution. Needs FElupe (`pip install "palpate[bench]"`). An interrupted run resumes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from palpate.compiler import kernel_cache
from palpate.compiler.trust import make_folder, may_read
from palpate.engine.provenance import machine
from palpate.physics.archive import replacing
from palpate.studies.accuracy import kidney, sites
from palpate.studies.accuracy.kidney import Kidney
from palpate.studies.accuracy.sites import SHIPPED, SITES, ReferenceSite, cells_text
from palpate.studies.peers import continuum, felupe
from palpate.studies.peers.continuum import BED, POISSON, RADIUS, YOUNG, ContinuumCurve, TissueBlock

MESHES = {"fe": (3, 5), "felupe": (2, 3)}
"""Solver -> cells across the patch radius of its coarser and finer mesh."""
NEAR = 2.0 * RADIUS
"""[m] Radius around the patch within which shapes are compared."""
Place = TissueBlock | Kidney


def kept(block: Place, solver: str) -> ContinuumCurve:
    """The curve of a solver, computed or loaded from the cache; the key includes the sources and FElupe's version."""
    key = f"{solver} {block} {felupe.version()} {_sources()}"
    path = sites.cache() / "curves" / f"{hashlib.sha256(key.encode()).hexdigest()[:20]}.npz"
    if may_read(path):
        with np.load(path) as file:
            stored = {f.name: file[f.name] for f in fields(ContinuumCurve)}
        return ContinuumCurve(**{**stored, "unknowns": int(stored["unknowns"])})
    curve = sites.compute_curve(block, solver)
    make_folder(path.parent)
    with replacing(path, cached=True) as part:
        np.savez(part, **{f.name: getattr(curve, f.name) for f in fields(ContinuumCurve)})
    return curve


@lru_cache(maxsize=1)
def _sources() -> str:
    """Hash of the sources that a curve depends on."""
    modules = (continuum, kidney, felupe)
    text = b"".join(Path(str(module.__file__)).read_bytes() for module in modules)
    return hashlib.sha256(text + kernel_cache.key().encode()).hexdigest()


def rebuild(
    names: list[str], provenance: dict[str, Any], folder: Path = SHIPPED, meshes: dict[str, tuple[int, int]] = MESHES
) -> Iterator[tuple[str, float]]:
    """Recompute and store the named references; yields the current task and the completed share."""
    todo = [(name, solver, cells) for name in names for solver in meshes for cells in meshes[solver]]
    curves_of: dict[tuple[str, str, int], ContinuumCurve] = {}
    for done, (name, solver, cells) in enumerate(todo):
        yield f"{name}: {solver}, {cells_text(cells)}", done / len(todo)
        curves_of[name, solver, cells] = kept(replace(SITES[name], cells=cells), solver)
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        curves = {solver: [curves_of[name, solver, cells] for cells in meshes[solver]] for solver in meshes}
        place = combined(SITES[name], curves, meshes)
        about = {
            **provenance,
            "place": asdict(SITES[name]),
            "solvers": {
                solver: {"cells a radius": meshes[solver], "unknowns": [c.unknowns for c in two],
                         "indentation": [c.indentation.tolist() for c in two]}
                for solver, two in curves.items()
            },
            "young": YOUNG, "poisson": POISSON, "bed": BED, "radius": RADIUS, "felupe": felupe.version(),
        }  # fmt: skip
        numbers = {f.name: getattr(place, f.name) for f in fields(ReferenceSite) if f.name != "about"}
        numbers["shape"] = place.shape.astype(np.float32)
        np.savez_compressed(folder / f"{name}.npz", **numbers, about=np.array(json.dumps(about)))
    sites.load_reference.cache_clear()
    yield "stored", 1.0


def combined(
    block: Place, curves: dict[str, list[ContinuumCurve]], meshes: dict[str, tuple[int, int]]
) -> ReferenceSite:
    """The reference from each solver's curves on its coarser and finer mesh."""
    # force, indentation, work: mean of the finer meshes
    fine = {solver: two[-1] for solver, two in curves.items()}
    base = fine["fe"]
    rest = {
        solver: 1.0 / ((meshes[solver][1] / meshes[solver][0]) ** 2 - 1.0) if len(two) > 1 else 1.0
        for solver, two in curves.items()
    }
    depth = np.mean([c.indentation for c in fine.values()], axis=0)
    apart = np.ptp([c.indentation for c in fine.values()], axis=0)
    left = np.max([rest[s] * np.abs(two[-1].indentation - two[0].indentation) for s, two in curves.items()], axis=0)
    work = np.mean([c.work for c in fine.values()], axis=0)
    numbers = (base.force, depth, work, apart + left, base.x, base.y)
    if not len(base.x):
        return ReferenceSite(*numbers, base.shape, np.zeros_like(depth), {})
    shapes = {s: [_carried(c, base) for c in two] for s, two in curves.items()}
    shape = np.mean([two[-1] for two in shapes.values()], axis=0)
    x, y = np.meshgrid(base.x, base.y, indexing="ij")
    near = np.hypot(x - block.place, y) < NEAR

    def rms(difference: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt((difference[:, near] ** 2).mean(axis=1)))

    last = [two[-1] for two in shapes.values()]
    shape_left = np.max([rest[s] * rms(two[-1] - two[0]) for s, two in shapes.items()], axis=0)
    shape_band = rms(last[0] - last[-1]) + shape_left
    return ReferenceSite(*numbers, shape, shape_band, {})


def _carried(curve: ContinuumCurve, base: ContinuumCurve) -> np.ndarray:
    """The shapes of a curve, interpolated to the grid of another one (L,x,y)."""
    if len(curve.x) == len(base.x) and np.allclose(curve.x, base.x) and len(curve.y) == len(base.y):
        return curve.shape
    at = np.stack(np.meshgrid(base.x, base.y, indexing="ij"), axis=-1)
    return np.array([RegularGridInterpolator((curve.x, curve.y), s, method="cubic")(at) for s in curve.shape])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("places", nargs="*", metavar="PLACE", help=f"of {', '.join(SITES)}; all if left out")
    names = parser.parse_args().places or list(SITES)
    if wrong := set(names) - set(SITES):
        parser.error(f"found {min(wrong)!r}, expected some of {', '.join(SITES)}")
    about = {**machine("numpy", "scipy", "numba"), "command": f"python benchmarks/references.py {' '.join(names)}"}
    for what, share in rebuild(names, about):
        print(f"{100 * share:3.0f} %  {what}", flush=True)


if __name__ == "__main__":
    main()
