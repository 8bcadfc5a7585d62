"""The same compressed block in FElupe and in CalculiX, peers that a user may have installed."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from palpate.fe import TetMesh

STEPS = 4


def felupe(mesh: TetMesh, shear: float, bulk: float, squeeze: float) -> dict[str, object] | None:
    """Force on the top [N] and time [s] with FElupe; None where it is not installed."""
    try:
        import felupe as fem
    except ImportError:
        return None
    try:
        from pypardiso import spsolve

        solver = "PARDISO"
    except ImportError:
        from scipy.sparse.linalg import spsolve

        solver = "SuperLU"
    begun = time.perf_counter()
    body = fem.Mesh(mesh.points, mesh.elements, "tetra10")
    field = fem.FieldContainer([fem.Field(fem.RegionQuadraticTetra(body), dim=3)])
    solid = fem.SolidBody(fem.NeoHooke(mu=shear, bulk=bulk), field)
    bounds, _ = fem.dof.uniaxial(field, move=0.0, axis=2, clamped=True, sym=False)
    for step in range(1, STEPS + 1):
        bounds["move"].update(-squeeze * step / STEPS)
        dof0, dof1 = fem.dof.partition(field, bounds)
        ext0 = fem.dof.apply(field, bounds, dof0)
        fem.newtonrhapson(
            items=[solid], dof0=dof0, dof1=dof1, ext0=ext0, solver=lambda a, b: spsolve(a.tocsr(), b), verbose=0
        )
    top = mesh.points[:, 2] > 1 - 1e-9
    force = solid.assemble.vector(field).toarray().reshape(-1, 3)[top, 2].sum()
    return {"solver": f"FElupe, {solver}", "force": float(force), "seconds": time.perf_counter() - begun}


def calculix(mesh: TetMesh, shear: float, bulk: float, squeeze: float) -> dict[str, object] | None:
    """Force on the top [N] and time [s] with CalculiX; None where `ccx` is not installed."""
    program = shutil.which("ccx")
    if program is None:
        return None
    z = mesh.points[:, 2]
    low, top = np.flatnonzero(z < 1e-9) + 1, np.flatnonzero(z > 1 - 1e-9) + 1
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i + 1}, {p[0]:.12g}, {p[1]:.12g}, {p[2]:.12g}" for i, p in enumerate(mesh.points)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=BODY")
    lines += [f"{i + 1}, " + ", ".join(str(n + 1) for n in e) for i, e in enumerate(mesh.elements)]
    for name, nodes in (("LOW", low), ("TOP", top)):
        lines += [f"*NSET, NSET={name}", *(f"{n}," for n in nodes)]
    lines += ["*MATERIAL, NAME=M", "*HYPERELASTIC, NEO HOOKE", f"{shear / 2:.12g}, {2 / bulk:.12g}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY", "LOW, 1, 3", "TOP, 1, 2"]
    lines += ["*STEP, NLGEOM, INC=100", "*STATIC, DIRECT", f"{1 / STEPS:g}, 1.0", "*BOUNDARY", f"TOP, 3, 3, {-squeeze}"]
    lines += ["*NODE PRINT, NSET=TOP, TOTALS=ONLY", "RF", "*END STEP"]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "block.inp").write_text("\n".join(lines) + "\n")
        begun = time.perf_counter()
        subprocess.run([program, "block"], cwd=folder, capture_output=True, check=True, timeout=3600)
        seconds = time.perf_counter() - begun
        rows = [r.split() for r in Path(folder, "block.dat").read_text().splitlines()]
    force = [float(r[2]) for r in rows if len(r) == 3][-1]
    return {"solver": "CalculiX", "force": force, "seconds": seconds}
