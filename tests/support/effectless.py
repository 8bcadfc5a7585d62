"""Which numeric settings of the shipped graphs change nothing: at 10 and 0.1 times the value.

python tests/support/effectless.py [GRAPH ...]       # prints those that change no byte and are not refused
"""

import contextlib
import random
import sys
import warnings
from collections.abc import Iterator
from functools import cache

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
    "nodule": ["scene.skin.afferents=on"], "texture": ["scene.skin.afferents=on", "scene.energy.ledger=on"],
    "pinch": ["scene.energy.ledger=on"],
    "fingertip-slide": ["hand.hold=50 ms", "hand.speed=20 mm/s"],
    "softness": ["scene.press.times=[0, 0.1, 0.15, 0.25]"],
}  # fmt: skip
DURATION = {"fingertip-slide": 0.6}  # [s]
USUAL, WHOLE = 0.3, 0.45  # [s] of a run: of other graphs, and of the whole touch of a graph whose path is played faster
HARDWARE = {"falcon", "falcons", "cartesian", "indentation"}  # they run on the real clock
NODULE = "tissue.nodule_radius=4 mm"
MATTERS = {
    "finger_hertz_slope": "{node}.finger_law=hertz", "finger_hertz_hardening": "{node}.finger_law=hertz",
    "finger_hertz_radius": "{node}.finger_law=hertz", "finger_power_stiffness": "{node}.finger_law=power",
    "finger_power_exponent": "{node}.finger_law=power", "area_radius": "scene.surface.area=ball",
    "area_modulus": "scene.surface.area=ball", "capsule_ratio": "tissue.capsule_thickness=1 mm",
    "nodule_ratio": NODULE, "nodule_depth": NODULE, "nodule_reach": NODULE,
    "tangential_stiffness": "effects.shape=on", "tangential_damping": "effects.shape=on",
    "slew": "tissue.use=deformation.Rigid", "speed_limit": "{device}.glitches=0.05", "reach": "effects.shape=on",
}  # fmt: skip
"""What a setting needs to have an effect: a choice of another setting, or a disturbance."""
WITHOUT = {
    "vertices": "approximate: neighbouring numbers make the same mesh of a built-in surface",
    "refine": "of mesh files alone; tests/physics/geometry/test_refined.py",
    "seed": "of random faults, which are off, and of noise that no reader of the graph wants",
    "catch_up": "of the pose after an outage of the device; tests/nodes/device/test_device_outage.py",
    "ramp": "of the recovery after an outage; tests/nodes/device/test_outage.py",
    "bound": "a limit for bodies that generate energy; tests/nodes/device/test_ledger_node.py",
    "depth_limit": "a limit beyond the depth of these touches; tests/nodes/test_probabilistic.py",
    "iterations": "a limit of a solver, which these touches do not reach",
    "hysteresis": "of a foot that changes its branch and of the end of a contact, which these touches do not have",
}
"""Settings by name that may change nothing, with the reason and the test that shows their effect."""


@cache
def sets_of(graph: str) -> tuple[list[str], float]:
    """Settings with which a short run has the whole touch of the graph, and its duration [s]."""
    given = SETS.get(graph, [])
    ends = {
        name: sum(segment.get("time") or segment.get("hold") for segment in spec.settings["path"])
        for name, spec in load(graph, overrides=given).nodes.items()
        if spec.settings.get("path") and "speed_factor" in spec.settings
    }
    if graph == "kidney" or not ends:
        return given, DURATION.get(graph, USUAL)
    return [*given, *(f"{name}.speed_factor={max(ends.values()) / WHOLE:.3g}" for name in ends)], WHOLE


def candidates(graph: str) -> Iterator[tuple[str, str, float]]:
    """(node, setting, value) of each numeric setting other than 0 of the nodes that run."""
    for name, spec in load(graph, overrides=sets_of(graph)[0]).nodes.items():
        if spec.off is None and not spec.observer:
            for setting in settings(spec.cls).values():
                value = spec.settings[setting.name]
                if numeric(setting) and value not in (None, 0, 0.0) and setting.name not in WITHOUT:
                    yield name, setting.name, value


def streams(graph: str, changes: list[str]) -> bytes | None:
    """The bytes of all messages of a run; None: the change is refused, or a node fails on it."""
    found = []
    with warnings.catch_warnings(), contextlib.suppress(PalpateError):
        warnings.simplefilter("ignore")
        given, duration = sets_of(graph)
        for tick in palpate.steps(graph, sets=[*given, *changes], duration=duration):
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
        device = next((other for other in devices if other.endswith(f"-{node}")), "device")
        needed = [MATTERS[name].format(node=node, device=device)] if name in MATTERS else []
        if (key := repr(needed)) not in usual:
            usual[key] = streams(graph, needed)
        if usual[key] is None and needed:
            continue  # the graph refuses what the setting needs
        spec = load(graph, overrides=sets_of(graph)[0]).nodes[node]
        integer = whole(settings(spec.cls)[name])
        values = [max(1, round(value * f)) if integer else value * f for f in (10, 0.1)]
        if all(streams(graph, [*needed, f"{node}.{name}={one!r}"]) == usual[key] for one in values if one != value):
            lost.append(f"{graph}: {node}.{name}={value}")
    return lost


if __name__ == "__main__":
    for given in sys.argv[1:] or sorted(file.stem for file in GRAPHS.glob("*.yaml") if file.stem not in HARDWARE):
        known = list(candidates(given))
        print(given, len(known), *effectless(given, random.Random(1).sample(known, len(known))), sep="\n  ", flush=True)
