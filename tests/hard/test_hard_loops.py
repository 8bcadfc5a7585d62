"""Hard cases of the closed loop: soft bodies with an encoder, deep presses, fingers that pinch a body.

In each the force stays within its limits, and the energy that the display generates is negligible."""

import numpy as np
import pytest
from expected_notes import BEYOND, FAST, UNTAKEN

from palpate import steps

LIMIT, SLEW, LEAK = 9.0, 5000.0, 2e-3  # [N], [N/s], [J]
SMALL = "scene.surface.vertices=1500"


def pressed(graph, controllers, duration, *sets, rate=1000):
    """Forces [N] (k,3) of each controller, whose limits they keep to."""
    forces = {name: [] for name in controllers}
    for tick in steps(graph, duration=duration, sets=(f"rate={rate}", *sets)):
        for name in controllers:
            message = tick[name]
            forces[name].append(message.force if message else (0.0, 0.0, 0.0))
            assert message is None or message.energy > -LEAK, (name, tick.time)
    for name, each in forces.items():
        each = np.array(each)
        assert np.isfinite(each).all(), name
        assert np.linalg.norm(each, axis=1).max() <= LIMIT * (1 + 1e-9), name
        assert np.linalg.norm(np.diff(each, axis=0), axis=1).max() <= SLEW / rate * (1 + 1e-9), name
        forces[name] = each
    return forces


def hand(*path, begin):
    motion = ", ".join(f"{{to: {list(to)}, time: {time}}}, {{hold: {hold}}}" for to, time, hold in path)
    return f"scene.hand.begin={list(begin)}", f"scene.hand.path=[{motion}]"


def noise(force, ticks):
    """RMS [N] of the last ticks about a parabola, which is the creep of a body that relaxes."""
    last = force[-ticks:]
    t = np.vander(np.linspace(-1.0, 1.0, ticks), 3)
    return float(np.sqrt(np.square(last - t @ np.linalg.lstsq(t, last, rcond=None)[0]).sum(axis=1).mean()))


BODIES = ["MassSpring", "ReducedFE", "BeamBundle"]
SEEDS = [pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 6)]


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("seed", [1, *SEEDS])
@pytest.mark.notes(UNTAKEN, body=("ReducedFE", "BeamBundle"))
@pytest.mark.notes(FAST, body="MassSpring")
def test_a_soft_body_under_an_encoder_presses_slides_and_holds_still(body, seed):
    """A hand of random stiffness pokes at a random place in 30 to 150 ms, drags sideways at once, and rests."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform((-0.025, -0.006), (0.025, 0.006))
    z = 0.105 - 0.004 * (abs(x) / 0.025) - rng.uniform(0.005, 0.012)
    poke, slide = rng.uniform(0.03, 0.15), rng.uniform(0.03, 0.2)
    x, y, z, poke, slide = (round(float(number), 5) for number in (x, y, z, poke, slide))
    rate = int(rng.choice([500, 1000, 2000]))
    sets = hand(((x, y, z), poke, 0.1), ((0.5 * x, -y, z - 1e-3), slide, 0.8), begin=(0.0, 0.0, 0.116))
    (force,) = pressed(
        "kidney", ["controller"], poke + slide + 0.9, SMALL, *sets, f"tissue.use=deformation.{body}",
        f"scene.hand.hand_stiffness={rng.uniform(300, 1500):.0f}", rate=rate,
    ).values()  # fmt: skip
    assert noise(force, round(0.3 * rate)) < 0.03


@pytest.mark.parametrize("depth", [0.088, pytest.param(0.080, marks=pytest.mark.long)])
@pytest.mark.notes(UNTAKEN, BEYOND)
def test_a_deep_press_of_the_reduced_organ(depth):
    """The hand is driven 17 to 25 mm into the organ: force rises with depth, and rests."""
    sets = hand(((0.0, 0.0, depth), 0.3, 0.7), begin=(0.0, 0.0, 0.112))
    (force,) = pressed("kidney", ["controller"], 1.0, SMALL, "tissue.use=deformation.ReducedFE", *sets).values()
    assert np.linalg.norm(force[-1]) > 2.2 and noise(force, 300) < 0.03


def test_a_deep_press_of_the_sampled_fingertip():
    """The hand is driven 6 mm into another person's fingertip, 5 mm deeper than the graph's touch."""
    sets = hand(((0.0, 0.0, 0.099), 0.3, 0.7), begin=(0.0, 0.0, 0.112))
    (force,) = pressed("fingertip", ["controller"], 1.0, *sets).values()
    assert np.linalg.norm(force[-1]) > 0.5 and noise(force, 300) < 0.03


@pytest.mark.parametrize("body", [b if b == "MassSpring" else pytest.param(b, marks=pytest.mark.long) for b in BODIES])
@pytest.mark.notes("keep each other apart")
def test_two_fingers_close_on_each_other(body):
    """Both press into the same tissue and move towards each other until 2 mm are left between them."""

    def path(x, near):
        return f"[{{to: [{x}, 0, 0.104], time: 0.2}}, {{to: [{near}, 0, 0.104], time: 0.3}}, {{hold: 0.4}}]"

    sets = [f"tissue.use=deformation.{body}", SMALL]
    for name, x, near in (("index", -0.012, -0.020), ("middle", -0.030, -0.022)):
        sets += [f"scene.{name}.begin=[{x}, 0, 0.115]", f"scene.{name}.path={path(x, near)}"]
    forces = pressed("palpate-two", ["controller-1", "controller-2"], 0.9, *sets)
    for force in forces.values():
        assert 0.2 < np.linalg.norm(force[-1]) < 5.0 and noise(force, 200) < 0.03
