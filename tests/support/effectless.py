"""Which numeric settings of the shipped graphs change nothing: at 10 and 0.1 times the value.

python tests/support/effectless.py [GRAPH ...]       # prints those that change no byte and are not refused
"""

import contextlib
import random
import sys
import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from setting_ends import numeric, whole

import palpate
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.messages import pack
from palpate.nodes.base import settings
from palpate.physics.errors import PalpateError

TOUCH = "[{hold: 0.02}, {to: [0, 0, 0.0935], time: 0.08}, {hold: 0.03}, {to: [0.03, 0, 0.097], time: 0.1}]"
SETS = {
    "kidney": [f"scene.hand.path={TOUCH}", "scene.energy.ledger=on", "scene.finger.band=on"],
    "nodule": ["scene.skin.afferents=on"],
    "pinch": ["scene.energy.ledger=on",],
    "fingertip-slide": ["hand.depth=1 mm", "hand.press=10 mm/s", "hand.hold=50 ms", "hand.speed=20 mm/s"],
    "remote": ["scene.network.delay=2 ms", "controller.delay=4"],
    "softness": ["scene.press.times=[0, 0.1, 0.15, 0.25]"],
}  # fmt: skip
SCENES = {"texture": "grating"}  # the scene whose nodes all run
DURATION = {"fingertip-slide": 0.6}  # [s]
USUAL, WHOLE = 0.3, 0.45  # [s] of a run: of other graphs, and of the whole touch of a graph whose path is played faster
HARDWARE = {"falcon", "falcons", "cartesian", "indentation"}  # they run on the real clock
NODULE = ("{node}.nodule_radius=4 mm",)
NODULE_AT_THUMB = (*NODULE, "{node}.nodule_position=[-0.026, -0.021, 0.084]")
BALL, BALL_OF_LIVER = ("scene.surface.area=ball",), ("liver.area=ball", "spread-liver.area=ball")
RIGID = ("tissue.use=deformation.Rigid",)
MATTERS = {
    "finger_hertz_slope": ("{node}.finger_law=hertz",), "finger_hertz_hardening": ("{node}.finger_law=hertz",),
    "finger_hertz_radius": ("{node}.finger_law=hertz",), "finger_power_stiffness": ("{node}.finger_law=power",),
    "finger_power_exponent": ("{node}.finger_law=power",), "area_radius": BALL, "area_modulus": BALL,
    "liver.area_radius": BALL_OF_LIVER, "liver.area_modulus": BALL_OF_LIVER,
    "spread-liver.area_radius": BALL_OF_LIVER, "spread-liver.area_modulus": BALL_OF_LIVER,
    "capsule_ratio": ("{node}.capsule_thickness=1 mm",),
    "nodule_ratio": NODULE, "nodule_depth": NODULE, "nodule_reach": NODULE,
    "pinch.nodule_ratio": NODULE_AT_THUMB, "pinch.nodule_depth": NODULE_AT_THUMB, "pinch.nodule_reach": NODULE_AT_THUMB,
    "display.travel": ("{node}.modulus=100",), "display.modulus": ("{node}.shows=force",),
    "display.spacing": ("{node}.shows=surface",),
    "tangential_stiffness": ("effects.shape=on",), "tangential_damping": ("effects.shape=on",),
    "reach": ("effects.shape=on",), "speed_limit": ("{device}.glitches=0.05",),
    "slew": RIGID, "organs.slew": ("kidney.use=deformation.Rigid",), "remote.slew": ("tissue.stiffness=5000",),
}  # fmt: skip
"""What a setting needs to have an effect, by its name or with that of node or graph: choices of other settings, or a
disturbance."""
WITHOUT = {
    "vertices": "approximate: neighbouring numbers make the same mesh of a built-in surface",
    "width": "of surfaces with gaps; tests/nodes/test_width.py",
    "walls": "of mesh files with walls that are near each other; tests/models/fe/test_walls.py",
    "refine": "of mesh files alone; tests/physics/geometry/test_refined.py",
    "seed": "of random faults, which are off, and of noise that no reader of the graph wants",
    "catch_up": "of the pose after an outage of the device; tests/nodes/device/test_device_outage.py",
    "ramp": "of the recovery after an outage; tests/nodes/device/test_outage.py",
    "shortest": "of measured profiles alone; tests/nodes/test_texture.py",
    "texture.speed": "refused if it is too high for the sampling, nothing else; tests/nodes/test_texture.py",
    **{
        f"fingertip.{name}": "of patches and inclusions that its stored basis refuses"
        for name in ("area_radius", "area_modulus", "capsule_ratio", "nodule_ratio", "nodule_depth", "nodule_reach")
    },
    "softness.spacing": "of shapes from a surface, which this graph lacks",
    "bound": "a limit for bodies that generate energy; tests/nodes/device/test_ledger_node.py",
    "depth_limit": "a limit beyond the depth of these touches; tests/nodes/test_probabilistic.py",
    "iterations": "a limit of a solver, which these touches do not reach",
    "hysteresis": "of a foot that changes its branch and of the end of a contact, which these touches do not have",
}
"""Settings, in the same form, that may change nothing, with the reason and the test that shows their effect."""


def entry(table: Mapping[str, Any], graph: str, node: str, name: str) -> Any:
    """The entry of a setting."""
    return next((table[key] for key in (f"{graph}.{name}", f"{node}.{name}", name) if key in table), None)


@cache
def sets_of(graph: str) -> tuple[list[str], float]:
    """Settings with which a short run has the whole touch of the graph, and its duration [s]."""
    given = SETS.get(graph, [])
    ends = {
        name: sum(segment.get("time") or segment.get("hold") for segment in spec.settings["path"])
        for name, spec in load(graph, overrides=given, scene=SCENES.get(graph)).nodes.items()
        if spec.settings.get("path") and "speed_factor" in spec.settings
    }
    if graph == "kidney" or not ends:
        return given, DURATION.get(graph, USUAL)
    return [*given, *(f"{name}.speed_factor={max(ends.values()) / WHOLE:.3g}" for name in ends)], WHOLE


def candidates(graph: str) -> Iterator[tuple[str, str, float]]:
    """(node, setting, value) of each numeric setting other than 0 of the nodes that run."""
    for name, spec in load(graph, overrides=sets_of(graph)[0], scene=SCENES.get(graph)).nodes.items():
        if spec.off is None and not spec.observer:
            for setting in settings(spec.cls).values():
                value = spec.settings[setting.name]
                if (
                    numeric(setting)
                    and value not in (None, 0, 0.0)
                    and entry(WITHOUT, graph, name, setting.name) is None
                ):
                    yield name, setting.name, value


def streams(graph: str, changes: list[str]) -> bytes | None:
    """The bytes of all messages of a run of all nodes; None: the change is refused, or a node fails on it."""
    found = []
    with warnings.catch_warnings(), contextlib.suppress(PalpateError):
        warnings.simplefilter("ignore")
        given, duration = sets_of(graph)
        sets = [*given, *changes]
        nodes = load(graph, overrides=sets, scene=SCENES.get(graph)).nodes.values()
        all_streams = [stream for spec in nodes if spec.off is None and not spec.observer for stream in spec.streams]
        sets.append(f"wanted={all_streams}")
        for tick in palpate.steps(graph, scene=SCENES.get(graph), sets=sets, duration=duration):
            if tick.number % 7 == 0:
                found += [pack(tick[stream]) for stream in tick.streams if tick[stream] is not None]
        return b"".join(found)
    return None


def effectless(graph: str, chosen: list[tuple[str, str, float]]) -> list[str]:
    """The settings that change no byte at 10 and 0.1 times their value."""
    usual: dict[str, bytes | None] = {}
    lost = []
    for node, name, value in chosen:
        devices = [name for name, spec in load(graph).nodes.items() if "glitches" in spec.settings]
        device = next((other for other in devices if other.split("-")[-1] == node.split("-")[-1]), "device")
        needed = [change.format(node=node, device=device) for change in entry(MATTERS, graph, node, name) or ()]
        if (key := repr(needed)) not in usual:
            usual[key] = streams(graph, needed)
        if usual[key] is None:  # the graph refuses what the setting needs, so it must refuse the setting
            needed, key = [], "[]"
            usual.setdefault(key, streams(graph, []))
        spec = load(graph, overrides=sets_of(graph)[0], scene=SCENES.get(graph)).nodes[node]
        integer = whole(settings(spec.cls)[name])
        values = [max(1, round(value * f)) if integer else value * f for f in (10, 0.1)]
        if all(streams(graph, [*needed, f"{node}.{name}={one!r}"]) == usual[key] for one in values if one != value):
            lost.append(f"{graph}: {node}.{name}={value}")
    return lost


if __name__ == "__main__":
    for given in sys.argv[1:] or sorted(file.stem for file in GRAPHS.glob("*.yaml") if file.stem not in HARDWARE):
        known = list(candidates(given))
        print(given, len(known), *effectless(given, random.Random(1).sample(known, len(known))), sep="\n  ", flush=True)
