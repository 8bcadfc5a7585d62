"""Derivatives of runs by parameters, against central differences of whole runs along the same path of the finger."""

import numpy as np
import pytest

import palpate
from palpate.launch.load.launchfile import find
from palpate.launch.sensitivity import resolved
from palpate.physics.errors import ArgumentError
from palpate.records.compare import compare
from palpate.records.samples import Run
from palpate.records.sensitivity import per

FINGER = ("contact.finger_stiffness", "contact.finger_hardening", "contact.finger_damping", "scene.finger.thickness")
QUICK = ("scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.1105]")
PRESS = ("scene.hand.path=[{to: [0, 0, 0.099], time: 0.15}, {to: [0.004, 0, 0.099], time: 0.08}, "
         "{to: [0, 0, 0.1105], time: 0.1}, {hold: 0.1}]",)  # fmt: skip
SPRING = {"scene.tissue.stiffness": 3e3, "tissue.exponent": 1.5, "tissue.damping": 5.0}
USUAL = {"contact.finger_stiffness": 26.2641, "contact.finger_hardening": 1681.06, "contact.finger_damping": 8.0,
         "scene.finger.thickness": 4e-3}  # fmt: skip
STEP = 1e-5


def held_to_differences(run: Run, values: dict[str, float], rel: float = 1e-5) -> None:
    """Hold force, compression and indentation at every tick, touch-down and release among them, to central differences
    by `STEP` of each parameter; errors are relative to the greatest derivative of the run."""
    variants = [()] + [(f"{name}={value * (1 + side)!r}",) for name, value in values.items() for side in (STEP, -STEP)]
    came: list[list[tuple[float, ...]]] = [[] for _ in variants]

    def collect(players):
        for rows, player in zip(came, players, strict=True):
            contact = player.last("contact")[0]
            rows.append((contact.force, contact.compression, contact.indentation))

    compare(run._recording, variants, on_tick=collect)
    out = np.array(came)
    assert np.array_equal(out[0, :, 0], run.contact.force)
    touching = np.asarray(run.contact.force) > 0.0
    assert touching.any() and not touching[0]
    for i, (name, value) in enumerate(values.items()):
        expected = (out[1 + 2 * i] - out[2 + 2 * i]) / (2.0 * STEP * value)
        for found, wanted in zip(run.sensitivity[name], expected.T, strict=True):
            scale = np.abs(wanted).max()
            assert scale > 0.0, (name, found.name)
            assert np.abs(found - wanted).max() <= rel * scale, (name, found.name)


def run_of(graph: str, names, tmp_path, *sets: str, **more) -> Run:
    return palpate.run(graph, sensitivity=list(names), record=tmp_path / "run.mcap", sets=[*sets], **more)


def test_a_press_on_mass_spring_is_differentiated_by_all_of_its_numbers(tmp_path):
    values = SPRING | USUAL
    run = run_of("kidney", values, tmp_path, *QUICK, *PRESS, duration=0.43)
    held_to_differences(run, values)
    assert run.contact.force[-1] == 0.0 and run.contact.force.max() > 1.0  # it lifts off
    force = run.sensitivity["scene.tissue.stiffness"].force
    assert force.unit == "N/(N/m^n)"
    assert np.array_equal(force.time, run.contact.time)
    assert run.sensitivity["tissue.exponent"].force.unit == "N"
    plain = palpate.run("kidney", record=tmp_path / "plain.mcap", sets=[*QUICK, *PRESS], duration=0.43)
    assert np.array_equal(plain.contact.force, run.contact.force)  # asking for derivatives changes nothing
    assert not plain.sensitivity


@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("power", {"contact.finger_power_stiffness": 8.1e3, "contact.finger_power_exponent": 1.5}),
        ("hertz", {"contact.finger_hertz_slope": 5.672e6, "contact.finger_hertz_hardening": 466.6,
                   "contact.finger_hertz_radius": 9.84e-3}),
    ],
)  # fmt: skip
def test_each_law_of_the_fingertip_is_differentiated(law, values, tmp_path):
    run = run_of("kidney", values, tmp_path, *QUICK, *PRESS, f"contact.finger_law={law}", duration=0.43)
    held_to_differences(run, values)


def test_a_press_on_reduced_finite_elements_is_differentiated_with_friction_and_its_own_history(tmp_path):
    values = {"tissue.young": 19e3, "tissue.retardation": 0.02} | USUAL
    run = run_of("kidney", values, tmp_path, *QUICK, *PRESS, tissue="deformation.ReducedFE", duration=0.43)
    held_to_differences(run, values)
    assert run.sensitivity["tissue.young"].force.unit == "N/Pa"
    assert float(np.asarray(run.friction.force)[:, 0].max()) > 0.05  # it slides


def test_the_linear_body_and_one_without_friction_are_differentiated(tmp_path):
    values = {"tissue.young": 19e3, "tissue.retardation": 0.02}
    sets = (*QUICK, *PRESS, "tissue.model=linear", "scene.tissue.friction=false")
    run = run_of("kidney", values, tmp_path, *sets, tissue="deformation.ReducedFE", duration=0.43)
    held_to_differences(run, values)


@pytest.mark.parametrize(
    ("body", "values", "sets"),
    [
        ("deformation.MassSpring", {"tissue.damping": 5.0}, ()),
        pytest.param(  # that basis ships
            "deformation.ReducedFE", {"tissue.retardation": 0.02}, ("tissue.nodule_radius=0",), marks=pytest.mark.long
        ),
    ],
)
def test_a_finger_that_slides_over_a_nodule_is_differentiated(body, values, sets, tmp_path):
    values = values | {"scene.finger.thickness": 4e-3, "contact.finger_stiffness": 26.2641}
    run = run_of("nodule", values, tmp_path, *sets, tissue=body, duration=1.0)
    held_to_differences(run, values)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tissue.stifness", "no 'stifness'.*stiffness"),
        ("scene.tissue.nothing", "no 'nothing'"),
        ("tissue.tangential_stiffness", "no derivative by tissue.tangential_stiffness.*tissue.stiffness"),
        ("scene.hand.mass", "reaches device.mass.*palpate study"),
        ("contact.finger_power_stiffness", "no derivative by contact.finger_power_stiffness"),
        ("contact.finger_law", "found 'exponential', expected a parameter that is a number"),
        ("spread.radius", "no derivative by spread.radius"),
    ],
)
def test_a_parameter_without_derivative_is_refused_before_the_run(name, expected):
    with pytest.raises(ArgumentError, match=expected):
        resolved(find("kidney"), [name])


@pytest.mark.parametrize(
    ("graph", "overrides", "expected"),
    [
        (
            "kidney",
            ("tissue.use=deformation.BeamBundle",),
            "is deformation.BeamBundle, expected deformation.MassSpring",
        ),
        ("kidney", ("tissue.use=deformation.ReducedFE", "tissue.model=sampled"), "model sampled, expected"),
        ("kidney", ("tissue.every=2",), "'tissue' runs at every 2 ticks"),
        ("palpate-two", (), "found joint .contact.Joint., expected one contact.Series"),
        ("fingertip", (), "sensitivity: "),
    ],
)
def test_a_graph_without_derivatives_is_refused(graph, overrides, expected):
    with pytest.raises(ArgumentError, match=expected):
        resolved(find(graph).but(overrides=overrides), ["tissue.stiffness"])


def test_a_real_clock_and_a_text_in_place_of_a_list_are_refused():
    with pytest.raises(ArgumentError, match="simulated time"):
        resolved(find("kidney").but(clock="real"), ["tissue.stiffness"])
    with pytest.raises(ArgumentError, match="expected a list"):
        resolved(find("kidney"), "tissue.stiffness")


def test_the_unit_of_a_derivative_is_one_of_the_units():
    assert per("N", "Pa") == "N/Pa" and per("N", "1") == "N" and per("N", "N/m^n") == "N/(N/m^n)"
