"""The cases of graveyard.py with the bodies, the contact and the controller of palpate."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Pose
from palpate.nodes.controller import Haptic
from palpate.records.reader import Recording

MODULI = (1e4, 1e5, 1e6, 1e7)
"""[Pa] from fat to cartilage."""
STEPS = (5e-4, 1e-3, 1e-2)  # [s]
STIFFNESS, SPEEDS = (100.0, 300.0, 1000.0, 3000.0), (0.05, 0.2, 1.0)  # [N/m], [m/s]


@functools.cache
def _kidney(*sets: str) -> dict[str, np.ndarray]:
    """The first 1.6 s of the shipped touch with reduced finite elements: force [N], and penetration [m], the approach
    minus the compression of the fingertip and the indentation of the tissue."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.mcap"
        launch = find("kidney").but(
            place="fused", overrides=("tissue.use=deformation.ReducedFE", *sets), duration=1.6, record=file
        )
        result = execute(launch).result
        assert result.ok, [str(death) for death in result.deaths]
        contact, near = Recording(file).columns("contact"), Recording(file).columns("collision")
    touching = contact["force"] > 0.0
    penetration = near["approach"] - contact["compression"] - contact["indentation"]
    return {"force": contact["force"], "penetration": np.abs(penetration[touching])}


def rates() -> str:
    """Peak force on the kidney at three loop rates."""
    runs = {rate: _kidney(f"rate={rate}")["force"] for rate in (1000, 500, 100)}
    return "; ".join(f"{1e3 / rate:g} ms: at most {force.max():.3f} N" for rate, force in runs.items())


def moduli() -> str:
    """Peak force on the kidney for each modulus."""
    return "; ".join(f"{young:.0e} Pa: {_kidney(f'tissue.young={young}')['force'].max():.2f} N" for young in MODULI)


def penetration() -> str:
    """Greatest penetration for each modulus."""
    return "; ".join(
        f"{young:.0e} Pa: {1e3 * _kidney(f'tissue.young={young}')['penetration'].max():.0e} mm" for young in MODULI
    )


def incompressible() -> str:
    """Force of the finite elements for each Poisson's ratio, over that on a mesh with elements of half the size."""
    from graveyard_felupe import mixed

    return mixed()


def turned() -> str:
    """Peak force on the kidney, and on the kidney rotated by 10 degrees about the axis of the press.

    The finger then touches another point of its surface.
    """
    lying, turned = _kidney()["force"], _kidney("scene.surface.rotation=[0, 0, 0.17453]")["force"]
    return f"0 degrees: at most {lying.max():.2f} N; 10 degrees: {turned.max():.2f} N"


def thrown() -> str:
    """Throws with passivity control."""
    return throws(controlled=True)


def throws(controlled: bool) -> str:
    """A grip of 0.3 kg thrown at walls: number of throws that rebound with more energy, and the largest gain."""
    outcomes = []
    for step in STEPS:
        gains = [_gain(step, stiffness, speed, controlled) for stiffness in STIFFNESS for speed in SPEEDS]
        more = sum(gain > 1.001 for gain in gains)
        outcomes.append(f"{1e3 * step:g} ms: {more} of {len(gains)} gain energy, at most {max(gains):.3g} ×")
    return "; ".join(outcomes)


def _gain(step: float, stiffness: float, speed: float, controlled: bool) -> float:
    """Kinetic energy after the rebound over the initial one."""
    node = Haptic(passivity=controlled)
    node.start()
    place, velocity, force = np.array([0.0, 0.0, 0.4 * speed * step]), np.array([0.0, 0.0, -speed]), np.zeros(3)
    for _ in range(int(2.0 / step)):
        push = force / 0.3
        place, velocity = place + step * (velocity + 0.5 * step * push), velocity + step * push
        depth = max(-place[2], 0.0)
        touch = Contact(
            foot=(0, 0, 0), normal=(0, 0, 1), force=stiffness * depth, compression=depth, indentation=0.0,
            compression_rate=0.0, indentation_rate=0.0, used=(0, 0),
        )  # fmt: skip
        seen = Pose(position=tuple(place), velocity=tuple(velocity), dt=step)
        force = np.array(node.step(touch, None, seen, None, dt=step).force)
        if place[2] > 0.0 and velocity[2] > 0.0:
            break
    return float((max(velocity[2], 0.0) / speed) ** 2)
