"""The loader sets whether something else than its finger moves the tissue of a controller (`Haptic.driven`)."""

import pytest

from palpate.launch.load.graph import load

SECOND = """
  device-2:     {use: device.Simulated, in: {torque: statics-2}, with: $hand}
  finger-2:     {use: kinematics.FalconKinematics, in: {state: device-2}}
  collision-2:  {use: collision.Nurbs, in: {pose: finger-2}, with: [$surface, $finger]}
  spread-2:     {use: spread.Kernel, in: {contact: contact-2}, with: $surface}
  controller-2: {use: controller.Haptic, in: {contact: contact-2, pose: finger-2, device: device-2}}
  statics-2:    {use: kinematics.FalconStatics, in: {force: controller-2, pose: finger-2}}
  ledger: null
  controller: {in: {ledger: null}}
"""
OTHER_ORGAN = f"""
extends: neighbours
nodes:
  between: {{in: {{second: [spread-2]}}}}
  contact-2:
    use: contact.Backed
    in: {{proximity: collision-2, body: kidney, neighbour: [side-kidney]}}
    with: $finger
  kidney: {{in: {{load: [spread-2, side-kidney]}}}}
{SECOND}
"""
APART = f"""
extends: kidney
nodes:
  contact-2: {{use: contact.Series, in: {{proximity: collision-2, body: other}}, with: $finger}}
  other: {{use: deformation.MassSpring, in: {{load: spread-2}}, with: [$surface, $tissue]}}
{SECOND}
"""


def driven(graph, **more):
    """The setting of each controller of a graph."""
    nodes = load(graph, **more).nodes
    return [spec.settings["driven"] for spec in nodes.values() if "driven" in spec.settings]


@pytest.mark.parametrize("name", ["kidney", "organs", "neighbours", "stack", "remote"])
def test_one_finger_alone_moves_organs_at_rest_also_through_others(name):
    assert driven(name) == [0]


@pytest.mark.parametrize("name", ["pinch", "pinch-liver", "palpate-two", "falcons"])
def test_two_fingers_move_the_tissue_of_each_other(name):
    assert driven(name) == [1, 1]


def test_fingers_on_a_rigid_body_do_not_move_it():
    """With `driven` the controllers gave 1.2 mJ to hands on a rigid plate, which neither had put in."""
    assert driven("palpate-two", overrides=["tissue.use=deformation.Rigid"]) == [0, 0]


def test_a_prescribed_motion_moves_it_too():
    assert driven("kidney", scene="breathing") == [1]


def test_a_finger_on_an_organ_moves_the_tissue_under_a_finger_on_its_neighbour(tmp_path):
    (tmp_path / "two.yaml").write_text(OTHER_ORGAN)
    assert driven(tmp_path / "two.yaml") == [1, 1]


def test_fingers_on_organs_that_do_not_touch_are_alone(tmp_path):
    (tmp_path / "apart.yaml").write_text(APART)
    assert driven(tmp_path / "apart.yaml") == [0, 0]


def test_a_given_value_stays():
    assert driven("kidney", overrides=["controller.driven=1"]) == [1]
    assert driven("pinch", overrides=["controller-thumb.driven=0"]) == [0, 1]


@pytest.mark.parametrize(("given", "noted"), [("tissue", False), ("null", True)])
def test_a_share_that_does_not_receive_the_body_of_its_joint_is_noted(given, noted):
    """Without it the controller cannot know that the joint lacked the body for a while."""
    notes = load("palpate-two", overrides=[f"contact-2.in.body={given}"]).notes
    found = [note for note in notes if note.startswith("contact-2 does not have the `body` of joint")]
    assert len(found) == noted and all("`contact-2: {in: {body: tissue}}`" in note for note in found)
    assert not any(note.startswith("contact-1 ") for note in notes)
