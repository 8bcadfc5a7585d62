"""Localise and size a nodule from touch: draw touches, train a regression, try it on an organ that it has not felt.

    python docs/examples/find_nodule.py [--touches N] [--seed S]

A fingertip on a noisy force-torque sensor slides over an organ in seven lines (palpation.yaml). The regression sees the
measured force and the measured position of the finger along these lines, and returns the place of the nodule on the
surface, its radius and its depth. It is trained on ellipsoids of random shape, tissue, finger, friction, sensor and
nodule, and tried on a liver with a tumour, both labels of a segmentation. Needs the extra `learn`.
docs/find_a_nodule.md has the figures.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import palpate
from palpate.physics.extras import missing

try:
    import nibabel
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.ensemble import ExtraTreesRegressor
    from sklearn.preprocessing import StandardScaler
except ImportError as error:
    sys.exit(missing("find_nodule.py", error.name, "learn"))

GRAPH = Path(__file__).with_name("palpation.yaml")
DURATION = 5.3  # [s]
FIELD = 10e-3  # [m] largest distance of a nodule from the middle of the field, along x and along y
RADII, DEPTHS, RATIOS = (3e-3, 7e-3), (7e-3, 12e-3), (3.0, 20.0)  # [m], [m] of the centre, [1]
LINES = np.linspace(-12e-3, 12e-3, 7)  # [m] y of the lines
PLACES = np.linspace(-11e-3, 11e-3, 12)  # [m] x at which a line is sampled
BEGIN, LINE, TURN = 0.9, 0.48, 0.1  # [s] first line, time of a line, time to the next one
TOP = 0.105  # [m] height of the organ's top in the graph
VOXEL = 2.5e-3  # [m]
HEIGHT = 0.028  # [m] of the liver's top above the origin of its file
PLACED = (f"scene.surface.position=[0, 0, {TOP - HEIGHT:g}]",)  # its origin under the middle of the lines


class Touches(NamedTuple):
    """Features (n, f) of touches, and what is to be found: x, y on the surface, radius, depth [m] (n,4)."""

    features: np.ndarray
    answers: np.ndarray


def write_organ(file: Path, level: Any, size: np.ndarray, tumour: tuple[np.ndarray, float] | None = None) -> None:
    """A segmentation with the voxels of `level` < 0 as label 1, and of a ball (centre, radius [m]) as label 2.

    size  [m] (3) half sides of the image
    """
    half = np.ceil(size / VOXEL).astype(int) + 2
    points = VOXEL * (np.moveaxis(np.indices(2 * half + 1), 0, -1) - half)
    voxels = (level(points) < 0.0).astype(np.uint8)
    if tumour is not None:
        voxels[np.linalg.norm(points - tumour[0], axis=-1) < tumour[1]] = 2
    affine = np.diag([1e3 * VOXEL] * 3 + [1.0])
    affine[:3, 3] = -1e3 * VOXEL * half
    nibabel.save(nibabel.Nifti1Image(voxels, affine), file)


def ellipsoid(points: np.ndarray, axes: np.ndarray, middle: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Below 0 inside; half axes [m] (3)."""
    return np.linalg.norm((points - np.asarray(middle)) / axes, axis=-1) - 1.0


def randomised(count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Tissue, finger, friction and sensor of each touch: distributions by name, and drawn lists."""
    return {
        "tissue.stiffness": {"published": "liver-human"},
        "contact.finger_law": rng.choice(["soft", "median", "stiff"], count).tolist(),  # of measured people
        "scene.finger.thickness": {"uniform": [3e-3, 5e-3]},
        "friction.mu_slide": {"uniform": [0.5, 0.7]},
        "wrench.noise": {"loguniform": [5e-4, 3e-3]},  # 5 to 30 mN
        "wrench.drift": {"uniform": [0.0, 5e-3]},
        "wrench.bias": {"uniform": [0.0, 5e-3]},
        "wrench.seed": rng.integers(0, 2**31, count).tolist(),
    }


def touch(organ: dict[str, Any], count: int, over: dict[str, Any], seed: int, sets: tuple[str, ...] = ()) -> np.ndarray:
    """Features (count, f) of touches of an organ with these settings."""
    ensemble = palpate.Ensemble(
        GRAPH, count, over, keep=["wrench.force", "finger.position"], organ=organ, sets=sets, duration=DURATION,
        every=5, seed=seed,
    )  # fmt: skip
    data = ensemble.run(quiet=True)
    return features(*(np.asarray(data[name]) for name in ("time", "wrench.force", "finger.position")))


def features(time: np.ndarray, force: np.ndarray, position: np.ndarray) -> np.ndarray:
    """The force along the lines as a map, less the quadric that curvature, drift and tissue leave in it, over its mean;
    and of the height of the finger, which the arm lets yield, the same.

    time [s] (t), force [N] and position [m] (n,t,3)
    """
    grid_x, grid_y = (each.ravel() for each in np.meshgrid(PLACES, LINES))
    basis = np.stack([np.ones_like(grid_x), grid_x, grid_y, grid_x**2, grid_y**2, grid_x * grid_y], axis=1)
    basis /= np.linalg.norm(basis, axis=0)
    found = []
    for f, p in zip(force, position, strict=True):
        maps = []
        for number, _ in enumerate(LINES):
            begin = BEGIN + number * (LINE + TURN)
            on = (time >= begin) & (time <= begin + LINE)
            order = np.argsort(p[on, 0])
            x = p[on, 0][order]
            maps.append([np.interp(PLACES, x, values[on][order]) for values in (f[:, 2], f[:, 0], p[:, 2])])
        rows = np.moveaxis(np.array(maps), 1, 0).reshape(3, -1)  # upward force, force along the line, height
        fitted = np.linalg.lstsq(basis, rows.T, rcond=None)[0]
        rest = rows - (basis @ fitted).T
        mean = rows[0].mean()
        found.append(np.concatenate([rest[0] / mean, rest[1] / mean, rest[2] / 1e-3, fitted[:, 0] / mean, [mean]]))
    return np.array(found)


def draw_training(folder: Path, count: int, organs: int, seed: int) -> Touches:
    """Touches of ellipsoids with half axes of 30 to 60, 25 to 45 and 15 to 30 mm, `count` in all."""
    rng, parts = np.random.default_rng(seed), []
    for number in range(organs):
        axes = rng.uniform([0.030, 0.025, 0.015], [0.060, 0.045, 0.030])
        file = folder / f"ellipsoid-{seed}-{number}.nii.gz"
        write_organ(file, lambda points, axes=axes: ellipsoid(points, axes), axes)
        each = count // organs
        x, y = rng.uniform(-FIELD, FIELD, (2, each))
        z = TOP + axes[2] * (np.sqrt(1.0 - (x / axes[0]) ** 2 - (y / axes[1]) ** 2) - 1.0)
        radius, depth = rng.uniform(*RADII, each), rng.uniform(*DEPTHS, each)
        nodule = {
            "scene.nodule.nodule_position": np.stack([x, y, z], axis=1).tolist(),
            "scene.nodule.nodule_radius": radius,
            "scene.nodule.nodule_depth": depth,
            "scene.nodule.nodule_ratio": {"loguniform": list(RATIOS)},
        }
        seen = touch({"file": str(file)}, each, randomised(each, rng) | nodule, seed + number)
        parts.append(Touches(seen, np.stack([x, y, radius, depth], axis=1)))
    return Touches(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def liver(points: np.ndarray) -> np.ndarray:
    """Below 0 inside of a liver of 110 mm: a thick and a thin lobe, with a fissure of 4 mm between them."""
    thick = ellipsoid(points, np.array([0.048, 0.042, 0.028]))
    thin = ellipsoid(points, np.array([0.040, 0.030, 0.014]), (0.042, 0.006, -0.002))
    fissure = (np.abs(points[..., 0] - 0.030) < 0.002) & (points[..., 1] > 0.0)
    return np.where(fissure, 1.0, np.minimum(thick, thin))


def draw_livers(folder: Path, tumours: int, lanes: int, seed: int) -> Touches:
    """Touches of the held-out liver with tumours at random places, each with several fingers, tissues and sensors."""
    rng, parts = np.random.default_rng(10_000 + seed), []
    for number in range(tumours):
        at, radius = rng.uniform(-FIELD, FIELD, 2), rng.uniform(*RADII)
        height = HEIGHT * np.sqrt(1.0 - (at[0] / 0.048) ** 2 - (at[1] / 0.042) ** 2)
        centre = np.array([*at, height - rng.uniform(*DEPTHS)])
        file = folder / f"liver-{seed}-{number}.nii.gz"
        write_organ(file, liver, np.array([0.085, 0.045, 0.030]), (centre, radius))
        organ = {"file": str(file), "label": "1+2"}
        tick = next(iter(palpate.steps(GRAPH, organ=organ, duration=0.01, sets=PLACED)))
        truth = tick.settings("tissue")
        answer = [*truth["nodule_position"][:2], truth["nodule_radius"], truth["nodule_depth"]]
        ratio = {"scene.nodule.nodule_ratio": {"loguniform": list(RATIOS)}}
        seen = touch(organ, lanes, randomised(lanes, rng) | ratio, 10_000 + seed + number, PLACED)
        parts.append(Touches(seen, np.tile(answer, (lanes, 1))))
    return Touches(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def peak_rule(seen: np.ndarray) -> np.ndarray:
    """Place (n,2) [m] without learning: mean of the places of a map, weighted with the force above its 90th percentile,
    as `palpate.gym.scripted.Search` does."""
    maps = seen[:, : len(PLACES) * len(LINES)].reshape(len(seen), len(LINES), len(PLACES))
    weight = np.maximum(maps - np.quantile(maps, 0.9, axis=(1, 2), keepdims=True), 0.0)
    x, y = (weight * PLACES).sum(axis=(1, 2)), (weight * LINES[:, None]).sum(axis=(1, 2))
    return np.stack([x, y], axis=1) / weight.sum(axis=(1, 2))[:, None]


def train(touches: Touches, seed: int) -> Any:
    """500 extremely randomised trees: P. Geurts et al., Mach. Learn. 63 (2006) 3-42. On the training touches, with two
    of six ellipsoids left out at a time, they had smaller errors than support vectors and small networks."""
    trees = ExtraTreesRegressor(500, min_samples_leaf=2, random_state=seed)
    return TransformedTargetRegressor(trees, transformer=StandardScaler()).fit(*touches)


def errors(found: np.ndarray, answers: np.ndarray) -> dict[str, float]:
    """Median and 90 % quantile of the distance on the surface, mean errors of radius and depth [mm]; of the columns
    that `found` (n,2 or 4) [m] has."""
    away = 1e3 * np.hypot(*(found[:, :2] - answers[:, :2]).T)
    row = {"place, median": float(np.median(away)), "place, 90 %": float(np.quantile(away, 0.9))}
    for column, name in enumerate(("radius, mean", "depth, mean"), start=2):
        if found.shape[1] > column:
            row[name] = float(1e3 * np.abs(found[:, column] - answers[:, column]).mean())
    return row


def main() -> None:
    made = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    made.add_argument("--touches", type=int, default=360, help="touches to train with")
    made.add_argument("--seed", type=int, default=0)
    given = made.parse_args()
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    with tempfile.TemporaryDirectory() as folder:
        trained = train(draw_training(Path(folder), given.touches, 6, given.seed), given.seed)
        felt = draw_livers(Path(folder), 5, 8, given.seed)
    for name, found in (("trees", trained.predict(felt.features)), ("largest force", peak_rule(felt.features))):
        print(
            f"{name:14}", *(f"{what} {value:.2f} mm" for what, value in errors(found, felt.answers).items()), sep="   "
        )


if __name__ == "__main__":
    main()
