"""`Ensemble.gradient` and `palpate.gradient`: against closed forms and separate runs, and what is no number."""

import random
import warnings

import numpy as np
import pytest

import palpate
from palpate.engine.faults import GraphError
from palpate.gradients.parameters import find_parameter
from palpate.launch.load.graph import load
from palpate.physics.errors import ArgumentError

pytest.importorskip("xarray")
IDEAL = ["scene.hand.ideal=true"]
FIELDS = {
    "kidney": "contact.force", "nodule": "contact.force", "fingertip": "contact.force", "texture": "contact.force",
    "neighbours": "contact.force", "organs": "both.Contact.force", "palpate-two": "contact-1.force",
    "pinch": "contact-thumb.force",
}  # fmt: skip
"""A force of every shipped graph whose nodes are all compiled; the others have hardware, a network or no such force."""
LONG_STEPS = np.array([6e-4, 3e-4, 1.5e-4])
"""Of the independent route, over the value; others than those of the derivative."""
NOISE = 1e-9  # [N] of a force, from the tolerances of implicit steps


def quiet(function, *given, **named):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", palpate.PalpateWarning)
        return function(*given, **named)


def force(graph, field, duration, *sets):
    """The field in a run by itself."""
    touch = palpate.Ensemble(graph, 1, {}, [field], sets=[*IDEAL, *sets], duration=duration)
    return quiet(touch.run, quiet=True)[field].values[0]


def richardson(graph, field, duration, path, value):
    """d(field)/d(path) by separate runs at three steps, with the change by the last extrapolation."""
    d = []
    for step in value * LONG_STEPS:
        up, down = (force(graph, field, duration, f"{path}={float(value + sign * step)!r}") for sign in (1, -1))
        d.append((up - down) / (2.0 * step))
    first, second = ((4.0 * d[j + 1] - d[j]) / 3.0 for j in (0, 1))
    return (16.0 * second - first) / 15.0, np.abs(second - first)


def test_a_press_at_rest_has_the_derivatives_of_the_closed_form():
    """Springs in series: hand k, finger (b/m)(e^(m s) - 1), tissue K s. dF/dx = -(ds/dx at F) / (compliance at F)."""
    found = palpate.gradient(
        "kidney", ["tissue.stiffness", "contact.finger_stiffness", "contact.finger_hardening", "device.hand_stiffness"],
        sets=IDEAL, duration=1.3,
    )  # fmt: skip
    f, big, b, m, k = float(found["contact.force"][-1]), 257.0, 26.2641, 1681.06, 500.0
    compliance = 1.0 / k + 1.0 / (b + m * f) + 1.0 / big
    hardening = np.log(1.0 + m * f / b) / m**2 - f / (m * (b + m * f))
    expected = np.array([f / big**2, f / (b * (b + m * f)), hardening, f / k**2]) / compliance
    assert (found["contact.force.reason"] == "").all()
    np.testing.assert_allclose(found["contact.force.derivative"].values[:, -1], expected, rtol=3e-4)
    assert list(found.unit.values) == ["N/m^n", "N/m", "1/m", "N/m"]


def check(graph, path, field, duration):
    """The largest deviation of a derivative from separate runs, over its RMS, and the share that does not settle."""
    found = quiet(palpate.gradient, graph, [path], [field], sets=IDEAL, duration=duration)
    derivative, error = (found[f"{field}.{part}"].values[0] for part in ("derivative", "error"))
    limit, change = richardson(graph, field, duration, path, float(found["value"].values[0]))
    settled = np.isfinite(derivative)
    assert settled.all() == (str(found[f"{field}.reason"].values[0]) == "")
    size = float(np.sqrt(np.mean(np.where(settled, limit, 0.0) ** 2)))
    scale = float(np.sqrt(np.mean(found[field].values ** 2))) / float(found["value"].values[0])
    noise = NOISE / (float(found["value"].values[0]) * LONG_STEPS[-1])
    unlike = np.abs(derivative - limit)[settled] - change[settled] - error[settled] - noise
    return float(unlike.max(initial=0.0)) / max(size, 1e-3 * scale), 1.0 - settled.mean()


def numbers(graph, field):
    """Paths of settings with a derivative."""
    loaded = load(graph, overrides=IDEAL)
    touch = palpate.Ensemble(graph, 1, {}, [field], sets=IDEAL, duration=0.1)
    running = {node.name for node in touch._prepared[0].job.nodes}
    for name in sorted(running & set(loaded.nodes)):
        for setting, value in loaded.nodes[name].settings.items():
            if type(value) is float and value != 0.0 and setting not in ("width", "refine", "spacing"):
                try:
                    parameter = find_parameter(loaded, f"{name}.{setting}", running)
                    if parameter.side(3e-3 * abs(value), value) == 0:
                        load(graph, overrides=[*IDEAL, f"{name}.{setting}={1.001 * value!r}"])
                except (ArgumentError, GraphError):  # frozen by a basis, or tied to the setting of another node
                    continue
                if parameter.side(3e-3 * abs(value), value) == 0:
                    yield f"{name}.{setting}"


def search(graph, count, duration, seed):
    paths = list(numbers(graph, FIELDS[graph]))
    for path in random.Random(seed).sample(paths, min(count, len(paths))):
        yield path, *check(graph, path, FIELDS[graph], duration)


@pytest.mark.parametrize("graph", ["kidney", "pinch"])
def test_derivatives_are_those_of_separate_runs(graph):
    for path, unlike, left in search(graph, 3, 0.9, seed=1):
        assert unlike < 1e-4, (graph, path)
        assert left < 0.5, (graph, path)


@pytest.mark.long
@pytest.mark.parametrize("graph", FIELDS)
def test_derivatives_of_every_graph_are_those_of_separate_runs(graph):
    for path, unlike, _ in search(graph, 30, 1.2, seed=2):
        assert unlike < 1e-4, (graph, path)


def test_with_an_encoder_there_is_no_number():
    found = palpate.gradient("kidney", ["tissue.stiffness"], duration=0.9)
    assert np.isnan(found["contact.force.derivative"]).all()
    assert float(found["contact.force"].max()) > 1.0
    reason = str(found["contact.force.reason"].values[0])
    assert "device.resolution (counts of the encoder)" in reason
    assert reason.endswith("smooth with --set scene.hand.ideal=true")


def test_events_that_move_are_reasons():
    found = palpate.gradient("kidney", ["device.speed_factor"], ["contact.force"], sets=IDEAL, duration=1.8)
    reason, derivative = str(found["contact.force.reason"].values[0]), found["contact.force.derivative"].values[0]
    assert "contact made or lost" in reason
    assert 0 < np.isnan(derivative).sum() < 0.2 * derivative.size


def test_lanes_parameters_and_points_of_the_path():
    touches = palpate.Ensemble("kidney", 2, {"tissue.stiffness": [200.0, 300.0]}, sets=IDEAL, duration=0.9)
    by = ["tissue.stiffness", "scene.hand.path[1].to[2]", "scene.finger.thickness"]
    found = touches.gradient(
        by, reduce={"peak": ("contact.force", "max"), "sum": ("contact.force", np.sum)}, quiet=True
    )
    assert found["peak.derivative"].shape == (2, 3)
    for lane, stiffness in enumerate((200.0, 300.0)):
        one = palpate.gradient("kidney", by, sets=[*IDEAL, f"tissue.stiffness={stiffness}"], duration=0.9)
        over = one["contact.force.derivative"].values
        assert np.isfinite(over).all()
        last = int(one["contact.force"].values.argmax())
        np.testing.assert_allclose(found["peak.derivative"].values[lane], over[:, last], rtol=1e-6)
        np.testing.assert_allclose(found["sum.derivative"].values[lane], over.sum(axis=1), rtol=1e-4)
    deeper = [{"hold": 0.2}, {"to": [0, 0, 0.0935 - 1e-5], "time": 0.5}, {"hold": 1}]
    path = palpate.Ensemble(
        "kidney", 1, {"scene.hand.path": [deeper], "tissue.stiffness": 200.0}, sets=IDEAL, duration=0.9
    )
    change = (path.run(quiet=True)["contact.force"].values.max() - float(found["peak"][0])) / -1e-5
    assert change == pytest.approx(float(found["peak.derivative"][0, 1]), rel=1e-3)


def test_at_its_limit_a_setting_has_a_one_sided_derivative():
    found = palpate.gradient("kidney", ["tissue.exponent"], sets=IDEAL, duration=0.9)  # at least 1
    base, more = (force("kidney", "contact.force", 0.9, f"tissue.exponent={n!r}") for n in (1.0, 1.0 + 1e-6))
    assert np.isfinite(found["contact.force.derivative"]).all()
    size = float(np.abs((more - base) / 1e-6).max())
    np.testing.assert_allclose(found["contact.force.derivative"][0], (more - base) / 1e-6, atol=2e-4 * size)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("surface.surface", "'kidney', a choice"),
        ("tissue.surface", "'kidney', a choice; expected a number"),
        ("friction.rescale", "True, a switch"),
        ("tissue.vertices", "10000, a whole number"),
        ("tissue.stifness", "Did you mean 'stiffness'"),
        ("tissu.stiffness", "Did you mean 'tissue'"),
        ("stiffness", "expected a setting, such as tissue.stiffness"),
        ("band.depth_limit", "does not run: finger.band is false"),
        ("scene.hand.path", "found a list of 24, expected one of its numbers"),
        ("scene.hand.path[99].to[2]", "found a list of 24, which has no 99"),
        ("scene.finger.width", "found None, no number"),
        ("scene.energy.bound", "is not in the plan"),
    ],
)
def test_what_is_no_parameter_is_refused_by_name(path, text):
    with pytest.raises(ArgumentError) as error:
        palpate.gradient("kidney", [path], sets=IDEAL, duration=0.1)
    assert text in str(error.value)
    assert path in str(error.value)


def test_what_a_basis_freezes_is_refused_with_what_varies():
    with pytest.raises(ArgumentError, match=r"'tissue.poisson': the stored basis .* these vary .*: .*young"):
        palpate.gradient("fingertip", ["tissue.poisson"], sets=IDEAL, duration=0.1)


def test_other_bad_arguments():
    touch = palpate.Ensemble("kidney", 1, sets=IDEAL, duration=0.1)
    for given, text in (
        ({"by": []}, "expected different settings"),
        ({"by": ["tissue.damping"]}, "is 0, so the size of its changes is unknown"),
        ({"by": ["tissue.stiffness"], "reduce": {"a": ("contact.force", "largest")}}, "expected max, min"),
        ({"by": ["tissue.stiffness"], "reduce": {"a": ("contact.x", "max")}}, "expected a kept field"),
        ({"by": ["tissue.stiffness"], "scale": {"tissue.damping": 1.0}}, "expected one of the parameters"),
        ({"by": ["tissue.stiffness"], "tolerance": 2.0}, "expected a number from 0 to 1"),
    ):
        with pytest.raises(ArgumentError, match=text):
            touch.gradient(**given)
    assert touch.gradient(["tissue.damping"], scale={"tissue.damping": 1.0}, quiet=True)["value"].item() == 0.0
