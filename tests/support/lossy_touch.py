"""Touches of the kidney that lose messages."""

from collections.abc import Callable

from palpate.studies.faults import touch
from palpate.studies.faults.chain import Chain, Lost, nothing
from palpate.studies.faults.touch import Felt

TICKS = 900
PATH = (
    "[{to: [0, 0, 0.0935], time: 0.2}, {hold: 0.15}, {to: [0.02, 0, 0.0925], time: 0.25, shape: linear},"
    "{to: [0, 0, 0.0955], time: 0.1}, {to: [0, 0, 0.113], time: 0.15}]"
)
TOUCH = ("scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]", f"scene.hand.path={PATH}")
OVER = 1.2  # [1]
TAP = (
    "scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]",
    "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.0425, shape: linear}, {hold: 0.3},"
    "{to: [0, 0, 0.110], time: 0.05, shape: linear}, {to: [0, 0, 0.095], time: 0.0425, shape: linear}, {hold: 0.2}]",
)  # fmt: skip
"""0.4 m/s."""
SLIDE = (
    "scene.surface.vertices=600", "scene.hand.begin=[-0.02, 0, 0.112]",
    "scene.hand.path=[{to: [-0.02, 0, 0.096], time: 0.12}, {hold: 0.08}, {to: [0.02, 0.004, 0.095], time: 0.15},"
    "{to: [-0.02, -0.004, 0.095], time: 0.1, shape: linear}, {hold: 0.1}, {to: [0.01, 0, 0.0945], time: 0.12},"
    "{to: [0.01, 0, 0.113], time: 0.15}]",
)  # fmt: skip
"""Along the kidney and back, at up to 0.5 m/s."""


def feel(run: Chain, lost: Lost, each: Callable[[int, Felt], None] = lambda tick, felt: None) -> Felt:
    """One touch with these losses; `each` is called before each tick."""
    run.lost = lost
    return touch.feel(run, TICKS, each)


def undisturbed(run: Chain, places: list[tuple[float, float, float]]) -> float:
    """Largest contact force [N] of the same motion without losses."""
    run.lost = nothing
    return touch.same_motion(run, places)[0]
