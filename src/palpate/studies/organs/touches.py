"""A touch: a surface, a body, a law of friction, a rate and the path of one or two fingers; as settings of a run."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.nodes import collision
from palpate.nodes.base.felt import felt_surface
from palpate.nodes.base.surface import OPEN, place_mesh
from palpate.physics.device.falcon import FALCON, HOME, leg
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.studies.organs.zoo import FAR, USUAL, mesh_of, specimen_of, write_mesh

THICKNESS = 4e-3  # [m] of the fingertip, as in the scenes
APART = 18e-3  # [m] between two fingers
SLOWEST, FASTEST = 1e-3, 0.3  # [m/s] of the hand
LONGEST = 0.5  # [s] of a move
DEEPEST = 30e-3  # [m] of the hand's target below the point of contact; the arm yields 2 mm/N
DEEPEST_RIGID = 14e-3  # [m] on a rigid body, where more than 9 N is beyond the device and the law of the fingertip
REST = 0.1  # [s] after the last move
TRIES = 200
ORIENTATIONS = tuple(map(tuple, Rotation.create_group("O").as_rotvec().tolist()))
"""[rad] The 24 orientations of a cube."""


@dataclass(frozen=True)
class Finger:
    """The path of a hand: where it begins and the device's frame lies [m], and its segments."""

    begin: tuple[float, float, float]
    origin: tuple[float, float, float]
    path: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Setting:
    """What the touches of one batch have in common.

    count     vertices of the mesh; 0: the NURBS patch
    rotation  [rad] of the surface
    friction  node of the law; "": none
    exact     whether the device reports positions without encoder steps
    width     [m] of the finger; 0: a point
    more      further values of `--set`, for nodes of the graph with one finger
    """

    surface: str
    count: int = USUAL
    body: str = "MassSpring"
    friction: str = "LuGre"
    rate: float = 1000.0
    fingers: int = 1
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    exact: bool = False
    width: float = 0.0
    more: tuple[str, ...] = ()

    @property
    def position(self) -> tuple[float, float, float]:
        """[m] of the frame of the surface, which puts its middle at the origin."""
        x, y, z = -Rotation.from_rotvec(self.rotation).apply(FAR) if self.count else (0.0, 0.0, 0.0)
        return (float(x), float(y), float(z))

    @property
    def graph(self) -> str:
        return "kidney" if self.fingers == 1 else "palpate-two"

    @property
    def tags(self) -> list[str]:
        """End of the names of the nodes of each finger."""
        return [""] if self.fingers == 1 else [f"-{k + 1}" for k in range(self.fingers)]

    def mesh(self) -> Mesh:
        """The surface at its place, as independent geometry."""
        return _placed_surface(self.surface, self.count or 4 * USUAL, self.rotation)

    def closest(self) -> MeshClosestPoint:
        return _closest(self.surface, self.count or 4 * USUAL, self.rotation)

    def felt(self, folder: Path) -> tuple[Mesh, MeshClosestPoint]:
        """What a finger of this width touches of the surface at its place; `folder` holds the meshes."""
        if not self.count or self.width == 0.0:
            return self.mesh(), self.closest()
        file = str(write_mesh(self.surface, self.count, folder))
        return _felt(file, self.position, self.rotation, self.width)


@dataclass(frozen=True)
class Touch:
    """A setting and the paths of its fingers."""

    setting: Setting
    fingers: tuple[Finger, ...]
    seed: tuple[int, ...] = field(default=(), compare=False)

    @property
    def duration(self) -> float:
        """[s]"""
        return max(sum(s.get("time", 0.0) + s.get("hold", 0.0) for s in f.path) for f in self.fingers) + REST

    def sets(self, folder: Path) -> list[str]:
        """The touch as values of `--set`; `folder` holds the meshes."""
        return [*surface_sets(self.setting, folder), *self.hand_sets()]

    def hand_sets(self) -> list[str]:
        hands = ["hand"] if self.setting.fingers == 1 else ["index", "middle"]
        texts = []
        for tag, hand, finger in zip(self.setting.tags, hands, self.fingers, strict=True):
            texts += [f"scene.{hand}.begin={list(finger.begin)}", f"scene.{hand}.path={json.dumps(finger.path)}"]
            texts += [f"{node}{tag}.origin={list(finger.origin)}" for node in ("device", "finger", "statics")]
        return texts

    def command(self, folder: Path) -> str:
        """The command that runs this touch."""
        sets = " ".join(f"--set '{text}'" for text in self.sets(folder))
        return f"palpate run {self.setting.graph} --fused --duration {self.duration:.4g} {sets}"

    def plain(self) -> dict[str, Any]:
        return asdict(self)


def surface_sets(setting: Setting, folder: Path) -> list[str]:
    """The values of `--set` that all touches of a setting share."""
    patch = specimen_of(setting.surface).patch
    name = str(write_mesh(setting.surface, setting.count, folder)) if setting.count else patch
    texts = [
        f"scene.surface.surface={name}", f"scene.surface.position={list(setting.position)}",
        f"scene.surface.rotation={list(setting.rotation)}", f"tissue.use=deformation.{setting.body}",
        f"scene.finger.width={setting.width:g}", *_of_each_finger(setting),
    ]  # fmt: skip
    if setting.count:
        texts.append("scene.surface.file_unit=mm")
    kind = "Mesh" if setting.count else "Nurbs"
    for tag in setting.tags:
        texts.append(f"collision{tag}.use=collision.{kind}")
        if setting.friction:
            texts.append(f"friction{tag}.use=friction.{setting.friction}")
        if setting.exact:
            texts += [f"device{tag}.resolution=0", f"finger{tag}.resolution=0", f"controller{tag}.resolution=0"]
    if not setting.friction:
        texts.append("scene.tissue.friction=false")
    if setting.fingers > 1 and setting.body != "Rigid":
        texts.append("scene.nodule.nodule_radius=0")
    if setting.rate != 1000.0:
        texts.append(f"rate={setting.rate:g}")
    return texts


def _of_each_finger(setting: Setting) -> list[str]:
    """The further values of `--set`: of a node of a finger for each finger; `contact` is the joint of two."""
    if setting.fingers == 1:
        return list(setting.more)
    texts = []
    for text in setting.more:
        node, _, rest = text.partition(".")
        tagged = [f"{node}{tag}.{rest}" for tag in setting.tags] if node in ("device", "spread") else [text]
        texts += [f"joint.{rest}"] if node == "contact" else tagged
    return texts


@lru_cache(maxsize=8)
def _placed_surface(surface: str, count: int, rotation: tuple[float, float, float]) -> Mesh:
    mesh = mesh_of(surface, count)
    return Mesh(Rotation.from_rotvec(rotation).apply(mesh.vertices), mesh.triangles)


@lru_cache(maxsize=8)
def _closest(surface: str, count: int, rotation: tuple[float, float, float]) -> MeshClosestPoint:
    return MeshClosestPoint(_placed_surface(surface, count, rotation))


def touched_surface(node: collision.Mesh) -> Mesh:
    """The surface of a node as it is loaded: a coarse mesh is refined, and what the finger cannot enter is bridged
    (`widths` has the bounds of bridges)."""
    felt = felt_surface(node, node.width).felt
    return node.mesh() if felt is None else place_mesh(felt.mesh, node.position, node.rotation)


@lru_cache(maxsize=32)
def _felt(
    file: str, position: tuple[float, float, float], rotation: tuple[float, float, float], width: float
) -> tuple[Mesh, MeshClosestPoint]:
    mesh = touched_surface(
        collision.Mesh(surface=file, file_unit="mm", position=position, rotation=rotation, width=width)
    )
    return mesh, MeshClosestPoint(mesh)


def draw_touch(setting: Setting, rng: np.random.Generator, folder: Path | None = None) -> Touch:
    """A random touch of a surface that begins outside of it, within reach of the device.

    folder  of the meshes; None: of the bare surface, as by a point
    """
    mesh, closest = (setting.mesh(), setting.closest()) if folder is None else setting.felt(folder)
    for _ in range(TRIES):
        touch = _draw_touch(setting, mesh, closest, rng)
        if all(map(reachable, touch.fingers)):
            break
    return touch


def _draw_touch(setting: Setting, mesh: Mesh, closest: MeshClosestPoint, rng: np.random.Generator) -> Touch:
    areas = np.linalg.norm(mesh.face_vectors, axis=1)
    if specimen_of(setting.surface).patch in OPEN:  # far from its border, beyond which a finger touches nothing
        inner = 0.25 * np.ptp(mesh.vertices, axis=0).max()
        areas = np.where(np.abs(mesh.vertices[mesh.triangles]).max(axis=(1, 2)) < inner, areas, 0.0)
    first, near = _place(mesh, areas, closest, rng), None
    most = DEEPEST_RIGID if setting.body == "Rigid" else DEEPEST
    fingers = [_finger(*first, most, rng)]
    if setting.fingers > 1:
        middle = mesh.vertices[mesh.triangles].mean(axis=1)
        away = np.linalg.norm(middle - first[0], axis=1)
        near = np.where((away > 0.6 * APART) & (away < 1.6 * APART), areas, 0.0)
        fingers.append(_finger(*_place(mesh, near if near.sum() > 0.0 else areas, closest, rng), most, rng))
    return Touch(setting, tuple(fingers))


def _place(
    mesh: Mesh, areas: np.ndarray, closest: MeshClosestPoint, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """A point of the surface [m], a direction of approach [1] and a distance [m] from which the approach is free."""
    share = areas / areas.sum()
    for _ in range(TRIES):
        t = rng.choice(len(share), p=share)
        u, v = sorted(rng.uniform(size=2))
        place = np.array([u, v - u, 1.0 - v]) @ mesh.vertices[mesh.triangles[t]]
        normal = closest.find(place + 1e-9)[1]
        tilt = rng.normal(size=3)
        tilt -= normal * (tilt @ normal)
        angle = np.deg2rad(50.0) * rng.uniform() ** 1.5
        toward = -normal * np.cos(angle) + tilt / np.linalg.norm(tilt) * np.sin(angle)
        begin = THICKNESS + rng.uniform(6e-3, 14e-3)
        free = closest.find(place - toward * np.linspace(begin, THICKNESS, 12)[:, None])[3]
        if free[0] > THICKNESS + 1e-3 and (free > 0.5e-3).all():
            return place, toward, begin
    return place, toward, begin


def _finger(place: np.ndarray, toward: np.ndarray, begin: float, most: float, rng: np.random.Generator) -> Finger:
    """A random motion: press, hold, slide or tap, lift."""
    speed = float(np.exp(rng.uniform(np.log(SLOWEST), np.log(FASTEST))))
    deep = float(rng.uniform(2e-3, most))
    start, touching, bottom = (place - toward * d for d in (begin, THICKNESS + 5e-4, THICKNESS - deep))
    along = np.cross(toward, rng.normal(size=3))
    along /= np.linalg.norm(along)
    kind = str(rng.choice(["press", "slide", "tap", "knead"]))
    shape = str(rng.choice(["linear", "minimum-jerk"]))
    path: list[dict[str, Any]] = []

    def go(there: np.ndarray, here: np.ndarray, fast: float, how: str = shape) -> np.ndarray:
        far = float(np.linalg.norm(there - here))
        path.append({"to": [round(float(x), 6) for x in there], "time": round(max(1e-2, min(far / fast, LONGEST)), 4),
                     "shape": how})  # fmt: skip
        return there

    here = go(touching, start, max(speed, 0.05), "minimum-jerk")
    if kind == "tap":
        here = go(bottom, here, max(speed, 0.1))
    else:
        here = go(bottom, here, speed)
        path.append({"hold": round(float(rng.uniform(0.15, 0.3)), 3)})
    if kind in ("slide", "knead"):
        for _ in range(1 if kind == "slide" else 2):
            far = min(float(rng.uniform(3e-3, 20e-3)), speed * LONGEST)
            deeper = rng.uniform(-0.5, 0.3) * deep * (kind == "knead")
            here = go(here + along * far + toward * deeper, here, speed)
            path.append({"hold": round(float(rng.uniform(0.1, 0.2)), 3)})
            along = np.cross(toward, along) if rng.uniform() < 0.5 else -along
    go(here - toward * float((here - start) @ toward), here, max(speed, float(rng.uniform(0.05, 0.15))), "minimum-jerk")
    points = np.array([start, *(s["to"] for s in path if "to" in s)])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) - HOME
    return Finger(_three(start), _three(np.round(middle, 4)), tuple(path))


def _three(point: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (round(float(c), 6) for c in point)
    return (x, y, z)


def reachable(finger: Finger) -> bool:
    """Whether the device reaches all points of a path."""
    points = [finger.begin, *(s["to"] for s in finger.path if "to" in s)]
    return all(leg(FALCON.geometry, i, *(np.array(p) - finger.origin).tolist())[0] for p in points for i in range(3))


def segments(finger: Finger) -> list[dict[str, Any]]:
    """The path as settings of a node."""
    blank = {"to": None, "time": None, "shape": None, "hold": None, "buttons": 0}
    return [blank | {"buttons": 0} | segment for segment in finger.path]
