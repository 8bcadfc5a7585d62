"""Settings that describe one thing in several nodes, such as the patch of the finger, have one value."""

import pytest

from palpate.engine.faults import GraphError
from palpate.launch.load.checks.agreeing import mark_of
from palpate.launch.load.classes import catalogue
from palpate.launch.load.graph import load
from palpate.nodes.base import settings

PAIRS = [
    ("kidney", "radius", 0.004, ["spread", "tissue"]),
    ("fingertip", "radius", 0.004, ["spread", "tissue"]),
    ("nodule", "radius", 0.006, ["spread", "tissue", "stress"]),
    ("nodule", "kernel", "cosine", ["spread", "stress"]),
    ("texture", "kernel", "cosine", ["spread", "stress", "relief"]),
    ("nodule", "poisson", 0.3, ["stress", "afferents"]),
    ("texture", "poisson", 0.3, ["stress", "relief", "afferents"]),
    ("kidney", "area_radius", 0.006, ["spread", "tissue"]),
    ("kidney", "thickness", 0.003, ["collision", "contact"]),
    ("remote", "thickness", 0.003, ["collision", "contact"]),
    ("organs", "thickness", 0.003, ["collision-kidney", "collision-liver", "contact-kidney", "contact-liver"]),
    ("palpate-two", "radius", 0.006, ["spread-1", "spread-2", "tissue"]),
    ("palpate-two", "thickness", 0.003, ["collision-1", "collision-2", "joint"]),
    ("kidney", "second_order", True, ["contact", "tissue"]),
    ("pinch", "origin", [0.0, 0.021, -0.026], ["device-index", "index", "statics-index"]),
    ("pinch", "mu_static", 0.9, ["friction-thumb", "friction-index", "grip"]),
    ("texture", "roughness", 0.08, ["texture", "relief"]),
    ("texture", "wavelength", 0.002, ["texture", "relief"]),
    ("fingertip-slide", "thickness", 0.004, ["hand", "finger"]),
]  # fmt: skip
SKIN = "scene.skin.afferents=on"


@pytest.mark.parametrize(("graph", "setting", "value", "names"), PAIRS, ids=[f"{g}-{s}" for g, s, *_ in PAIRS])
def test_one_value_reaches_all_nodes_and_two_are_refused(graph, setting, value, names):
    skin = [SKIN] if graph in ("nodule", "texture") else []
    nodes = load(graph, overrides=skin).nodes
    with_it = [name for name, spec in nodes.items() if setting in spec.settings and spec.off is None]
    usual = nodes[names[0]].settings[setting]
    for name in names:
        try:
            found = load(graph, overrides=[*skin, f"{name}.{setting}={value}"]).nodes
        except GraphError as error:  # the scene gives it to the others
            (fault,) = error.faults
            assert fault.setting == setting and "expected one value" in fault.text and fault.node in names
            assert name in fault.text and str(fault.place).strip()
            continue
        assert all(found[other].settings[setting] == value for other in names)
        for other in set(with_it) - set(names):
            assert found[other].settings[setting] == nodes[other].settings[setting], other
    found = load(graph, overrides=[*skin, *(f"{name}.{setting}={value}" for name in names)]).nodes
    assert all(found[name].settings[setting] == value for name in names)
    if usual != value:
        with pytest.raises(GraphError, match="expected one value"):
            load(graph, overrides=[*skin, f"{names[0]}.{setting}={value}", f"{names[-1]}.{setting}={usual}"])


@pytest.mark.parametrize(("sets", "widths"), [
    ([], (0.016, 0.016, 0.016)),
    (["collision-1.width=0"], (0.0, 0.016, 0.016)),
    (["spread-1.width=0.02"], (0.02, 0.016, 0.02)),
    (["scene.finger.width=0"], (0.0, 0.0, 0.0)),
    (["spread-2.radius=0.01", "tissue.radius=0.01", "spread-1.radius=0.01"], (0.02, 0.02, 0.02)),
    (["tissue.width=0.01"], (0.016, 0.016, 0.01)),
])  # fmt: skip
def test_a_body_of_beams_takes_the_width_of_the_widest_finger_and_changes_none(sets, widths):
    """A stylus next to a fingertip: the width of the one became that of the other, without a word."""
    nodes = load("palpate-two", overrides=["tissue.use=deformation.BeamBundle", *sets]).nodes
    first, second, body = widths
    for tag, width in (("1", first), ("2", second)):
        assert all(nodes[f"{name}-{tag}"].settings["width"] == width for name in ("collision", "spread"))
    assert nodes["tissue"].settings["width"] == body


def test_settings_that_agree_have_one_default():
    """In all shipped classes, so that a graph that sets none of them has one value."""
    defaults = {}
    for entry in catalogue()[0]:
        for setting in settings(entry.cls).values():
            if mark_of(setting):
                defaults.setdefault(setting.name, {}).setdefault(repr(setting.default), []).append(entry.use)
    thick = defaults.pop("thickness")
    assert {"fingertip.Slide", "fingertip.BundleContact"} == set(thick.pop("0.005")) and len(thick) == 1
    assert set(defaults) == {
        "area", "area_radius", "area_modulus", "area_forces", "area_radii", "radius", "kernel", "poisson",
        "second_order", "origin", "mu_static", "plate", "spectrum", "wavelength", "profile", "map", "shortest",
        "roughness", "direction", "seed", "width",
    }  # fmt: skip
    assert {name: len(found) for name, found in defaults.items()} == dict.fromkeys(defaults, 1)


def test_the_patch_of_the_spread_is_that_of_the_body():
    """Only the radius of the body caused a note; that of the spread did not reach the body."""
    for sets in (["spread.radius=4 mm"], ["tissue.radius=4 mm"], ["spread.radius=4 mm", "tissue.radius=4 mm"]):
        nodes = load("kidney", overrides=sets).nodes
        assert nodes["spread"].settings["radius"] == nodes["tissue"].settings["radius"] == 4e-3
    with pytest.raises(GraphError, match=r"found 0.004 in spread \(--set spread.radius=4 mm\) and 0.005 in tissue"):
        load("fingertip", overrides=["spread.radius=4 mm", "tissue.use=deformation.ReducedFE"])


def test_an_energy_balance_has_the_delay_of_the_device():
    """The controller's, less that of a network, behind which the force acts as late as the device reports."""
    on = "scene.energy.ledger=on"
    for graph, sets, delay in (
        ("kidney", [], 0), ("kidney", ["controller.delay=2"], 2), ("falcon", [], 3), ("cartesian", [], 3),
        ("remote", [], 0), ("remote", ["controller.delay=43"], 3), ("pinch", ["controller-thumb.delay=1"], 1),
        ("falcons", [], 3), ("texture", ["controller.delay=4"], 4),
    ):  # fmt: skip
        graph = load(graph, overrides=[on, *sets])
        assert graph.nodes["ledger"].settings["delay"] == delay and not graph.notes
    (note,) = load("kidney", overrides=[on, "ledger.delay=1"]).notes
    assert "delay: 1 samples, but the force acts 0 samples after" in note and "--set ledger.delay=0" in note
