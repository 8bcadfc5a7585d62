"""Force error of every body on random touches all over the kidney, against deformation.ReducedFE.

    python benchmarks/every_place.py [--touches 200] [--seed 1] [--out every_place.json]

A touch begins 6 mm outside a random place of the surface (uniform over its area). The hand presses along the inward
normal to a random approach of 2 to 9 mm in 0.3 s, rests for 0.2 s, moves by 10 mm along the surface in a random
direction at 10 to 150 mm/s, rests for 0.2 s and lifts. It is stiff (20 kN/m) and its positions are exact, so that all
bodies get the same motion. Friction is that of the scene. Each touch is a lane of an ensemble.

Prints quantiles of the error at the end of each rest, and RMS and peak over the touch, over the peak of the reference.
The JSON holds them for each touch, with place [m], normal, approach [m], speed [m/s], peak force [N] of the reference
and `kick` [1], this peak over the force at the end of the first rest. docs/pictures/every_place.json is that of the
default settings. Takes 2 minutes on two cores.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import palpate
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.device.hand import HOME

PLACE = (0.0, 0.0, 0.084)  # [m] of the kidney in its scene
THICKNESS, CLEAR, STROKE = 4e-3, 6e-3, 10e-3  # [m] of the finger, above the surface, of the slide
PRESS, HOLD, LIFT = 0.3, 0.2, 0.3  # [s]
STIFF = ["hand_stiffness=20000", "hand_damping=200"]
HALF_SPACE = 250  # [N/m] K of MassSpring with a stiffness map, 257 over the map at the top
BODIES: dict[str, list[str]] = {
    "ReducedFE": ["tissue.use=deformation.ReducedFE"],
    "MassSpring": [],
    "MassSpring, map": ["tissue.stiffness_map=basis", f"tissue.stiffness={HALF_SPACE}"],
    "BeamBundle": ["tissue.use=deformation.BeamBundle"],
}


def touches(count: int, seed: int) -> dict[str, np.ndarray]:
    """Places [m], normals [1] and directions of the slide [1] (n,3), approaches [m] (n) and speeds [m/s] (n)."""
    rng = np.random.default_rng(seed)
    mesh = surface_mesh("kidney", 10000, PLACE)
    at = rng.choice(len(mesh.areas), count, p=mesh.areas / mesh.areas.sum())
    normals = mesh.normals[at]
    along = np.cross(normals, rng.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1)[:, None]
    return {
        "place": mesh.vertices[at], "normal": normals, "direction": along,
        "approach": rng.uniform(2e-3, 9e-3, count), "speed": np.exp(rng.uniform(np.log(0.01), np.log(0.15), count)),
    }  # fmt: skip


def lanes(given: dict[str, np.ndarray]) -> tuple[dict[str, list[Any]], np.ndarray, float]:
    """Settings of each lane; ends [s] (n,3) of both rests and of the touch; duration [s] of the longest."""
    n, foot, slide = given["normal"], given["place"], STROKE / given["speed"]
    free = foot + (THICKNESS + CLEAR) * n
    deep = foot + (THICKNESS - given["approach"][:, None]) * n
    other = deep + STROKE * given["direction"]
    paths = [
        [
            {"to": d.tolist(), "time": PRESS}, {"hold": HOLD}, {"to": o.tolist(), "time": t, "shape": "linear"},
            {"hold": HOLD}, {"to": (o + f - d).tolist(), "time": LIFT},
        ]
        for d, o, f, t in zip(deep, other, free, slide.tolist(), strict=True)
    ]  # fmt: skip
    origins = (free - np.array(HOME)).tolist()
    over = {f"{node}.origin": origins for node in ("device", "finger", "statics")}
    over |= {"device.begin": free.tolist(), "device.path": paths}
    first = np.full(len(slide), PRESS + HOLD)
    ends = np.stack([first, first + slide + HOLD, first + slide + HOLD + LIFT], axis=1)
    return over, ends, float(ends.max())


def forces(body: str, over: dict[str, list[Any]], duration: float) -> np.ndarray:
    """Contact force [N] (n,ticks) of all touches."""
    sets = [f"scene.hand.{each}" for each in STIFF]
    sets += [f"{node}.resolution=0" for node in ("device", "finger", "controller")]
    ensemble = palpate.Ensemble(
        "kidney", len(over["device.path"]), over, ["contact.force"], duration=duration, sets=[*sets, *BODIES[body]]
    )
    return np.asarray(ensemble.run(quiet=True)["contact.force"])


def errors(force: np.ndarray, reference: np.ndarray, ends: np.ndarray) -> dict[str, float]:
    """Errors [1] of one touch: at the end of both rests, RMS and largest until its end, over the reference's peak."""
    first, second, last = (round(1000 * end) for end in ends)
    peak = float(reference[:last].max())
    off = force[:last] - reference[:last]
    return {
        "press": float(force[first - 1] / reference[first - 1] - 1.0) if reference[first - 1] > 0 else float("nan"),
        "after slide": float(force[second - 1] / reference[second - 1] - 1.0)
        if reference[second - 1] > 0.05 * peak
        else float("nan"),
        "rms": float(np.sqrt(np.mean(off**2)) / peak),
        "peak": float(force[:last].max() / peak - 1.0),
    }


def rounded(value: Any) -> Any:
    """The same data with five digits; null for an unknown number."""
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.5g}") if np.isfinite(value) else None
    return value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--touches", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("every_place.json"))
    given = parser.parse_args()
    found = touches(given.touches, given.seed)
    over, ends, duration = lanes(found)
    computed = {body: forces(body, over, duration) for body in BODIES}
    reference = computed.pop("ReducedFE")
    table = {body: [errors(*each) for each in zip(force, reference, ends, strict=True)]
             for body, force in computed.items()}  # fmt: skip
    peaks = np.array([f[: round(1000 * e[2])].max() for f, e in zip(reference, ends, strict=True)])
    rests = np.array([f[round(1000 * e[0]) - 1] for f, e in zip(reference, ends, strict=True)])
    data = {
        "command": f"benchmarks/every_place.py --touches {given.touches} --seed {given.seed}",
        "reference": "deformation.ReducedFE", "touches": {name: value.tolist() for name, value in found.items()},
        "peak": peaks.tolist(), "kick": (peaks / rests).tolist(), "errors": table,
    }  # fmt: skip
    given.out.write_text(json.dumps(rounded(data)) + "\n")
    print("| body | error | 5 % | 25 % | median | 75 % | 95 % | worst |\n|---|---|---|---|---|---|---|---|")
    for body, rows in table.items():
        for name in rows[0]:
            values = np.array([row[name] for row in rows])
            values = values[np.isfinite(values)]
            worst = values[np.abs(values).argmax()]
            cells = [f"{100 * q:.1f}" for q in (*np.percentile(values, (5, 25, 50, 75, 95)), worst)]
            print(f"| {body} | {name} | {' | '.join(cells)} |")
    print(f"{len(peaks)} touches, peak force {peaks.min():.2f} to {peaks.max():.2f} N; error in % of the peak")


if __name__ == "__main__":
    main()
