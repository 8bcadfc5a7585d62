"""The public API in one script: a run, an ensemble, a study, an environment, messages and two custom nodes.

    python docs/examples/public_api.py

Type checkers (pyright, mypy) report nothing here.
"""

import tempfile
from typing import Annotated

import gymnasium
import numpy as np

import palpate
import palpate.gym
from palpate.messages import Contact, Force, Pose, Proximity, pack, unpack
from palpate.nodes import CompiledNode, Node, Out, kernel
from palpate.physics import neo_hooke, stribeck
from palpate.physics.errors import PalpateError


class Gain(Node):
    """Multiplies a force by a factor, in Python."""

    factor: Annotated[float, "1"] = 1.0

    def step(self, contact: Contact, pose: Pose | None) -> Force:
        push = self.factor * contact.force * np.asarray(contact.normal)
        return Force(force=(float(push[0]), float(push[1]), float(push[2])), state="contact", energy=0.0)


class Spring(CompiledNode):
    """A penalty spring along the normal, compiled."""

    stiffness: Annotated[float, "N/m"] = 300.0

    State = {"deepest": ()}

    @kernel
    def compute(own, proximity: Proximity, out: Out[Force], dt):
        own.deepest = max(own.deepest, proximity.approach)
        for i in range(3):
            out.force[i] = own.stiffness * max(proximity.approach, 0.0) * proximity.normal[i]


def touch() -> None:
    """A run, its fields, a comparison with another body, and the same tick by tick."""
    run = palpate.run("kidney", duration=0.5, tissue={"stiffness": 200.0})
    force = run.contact.force
    print(f"{force.max():.3f} {force.unit}, {len(force.time)} messages")
    print(run["contact.force"].label, run.contact[100].tick)
    for tick in palpate.steps("kidney", duration=0.05):
        if tick.contact.force > 1.0:
            tick.set("tissue", stiffness=100.0)
            break


def many() -> None:
    """An ensemble and a study over the stiffness of the tissue."""
    stiffness = np.linspace(100.0, 400.0, 8)
    ensemble = palpate.Ensemble("kidney", 8, {"tissue.stiffness": stiffness}, keep=["contact.force"], duration=0.5)
    force = np.asarray(ensemble.run(quiet=True)["contact.force"])
    print(force.shape, f"{force.max():.3f} N")
    with tempfile.TemporaryDirectory() as folder:
        study = palpate.Study("kidney", {"tissue.stiffness": [200.0, 400.0]}, ["peak contact.force"], duration=0.5)
        print(study.run(folder).table())


def learn() -> None:
    """An environment with random actions."""
    env = gymnasium.make("palpate/Touch-v0")
    env.reset(seed=1)
    _, reward, *_ = env.step(env.action_space.sample())
    print(reward)
    env.close()


def alone() -> None:
    """Messages, nodes and laws without a graph."""
    node = Gain(factor=2.0)
    up, zero = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    sent = Contact(
        foot=zero, normal=up, force=0.5, compression=1e-3, indentation=2e-3, compression_rate=0.0, indentation_rate=0.0
    )
    contact = unpack(pack(sent), Contact)
    print(node.step(contact, None).force)
    spring = Spring(stiffness=500.0)
    spring.start()
    near = Proximity(foot=zero, normal=up, coordinates=(0.0, 0.0), element=0, gap=-1e-3, approach=1e-3, slip=zero)
    print(spring.step(near, dt=1e-3).force)
    print(neo_hooke(20e3, 0.48), stribeck(0.01, 0.6, 0.9, 0.01))


if __name__ == "__main__":
    try:
        touch()
        many()
        learn()
        alone()
    except PalpateError as error:
        raise SystemExit(str(error)) from None
