"""The shipped kidney graph: invariants of a whole touch, and independence of placement and pruning."""

import random
from pathlib import Path

import numpy as np
import pytest
from graphs_for_runs import write_place
from msgspec.structs import replace

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording
from palpate.views.pictures.friction import beyond_dip, regions, sliding
from palpate.views.pictures.touch import TouchStreams, touches, work

T = 1e-3  # [s]
NODES = ("device", "finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics")
QUICK = (
    "scene.surface.vertices=1500",
    "scene.hand.begin=[-0.02, 0, 0.111]",
    "scene.hand.path=[{to: [-0.02, 0, 0.098], time: 0.15}, {to: [0.02, 0, 0.097], time: 0.3},"
    " {to: [0.02, 0, 0.115], time: 0.15}]",
)


def run(folder: Path, *sets: str, name: str = "run", **more) -> Recording:
    launch: LaunchFile = find("kidney").but(record=folder / f"{name}.mcap", overrides=sets, **more)
    outcome = execute(launch)
    assert outcome.result.ok, [str(death) for death in outcome.result.deaths]
    return Recording(folder / f"{name}.mcap")


def payloads(recording: Recording) -> dict[str, list[bytes]]:
    by_stream: dict[str, list[bytes]] = {}
    for name, _, payload in recording.payloads():
        by_stream.setdefault(name, []).append(payload)
    return by_stream


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The whole shipped touch, on a coarser mesh."""
    return run(tmp_path_factory.mktemp("whole"), "scene.surface.vertices=1500", place="fused")


@pytest.fixture(scope="module")
def columns(whole):
    return {name: whole.columns(name) for name in NODES}


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """A short touch with a stroke in it."""
    return payloads(run(tmp_path_factory.mktemp("quick"), *QUICK, place="fused", duration=0.65))


def test_every_number_is_finite_and_every_node_ran_at_every_tick(columns):
    for name, stream in columns.items():
        assert stream["tick"].tolist() == list(range(6300)), name
        assert all(np.isfinite(values).all() for values in stream.values()), name


def test_the_finger_presses_several_millimetres_and_never_pulls(columns):
    force, depth = columns["contact"]["force"], columns["contact"]["indentation"]
    assert (force >= 0.0).all() and (depth >= 0.0).all() and (columns["contact"]["compression"] >= 0.0).all()
    assert 8e-3 < depth.max() < 10e-3
    assert columns["contact"]["compression"].max() < 4e-3  # the bone stays above the tissue


def test_the_force_on_the_hand_is_at_most_that_of_the_device(columns):
    size = np.linalg.norm(columns["controller"]["force"], axis=1)
    assert 2.5 < size.max() <= 9.0
    assert np.abs(columns["statics"]["torques"]).max() <= 0.4096 + 1e-12


def test_the_force_is_zero_out_of_contact(columns):
    size = np.linalg.norm(columns["controller"]["force"], axis=1)
    slices = touches(columns["contact"]["time"], columns["contact"]["force"])
    assert len(slices) == 2
    assert (size[: slices[0].start + 1] == 0.0).all()
    for end, begin in ((slices[0].stop, slices[1].start), (slices[1].stop, len(size))):
        assert (size[end : begin + 1] == 0.0).all()


def test_finger_and_tissue_share_the_approach(columns):
    contact, near = columns["contact"], columns["collision"]
    touching = contact["force"] > 0.0
    shared = contact["compression"] + contact["indentation"]
    assert np.abs(shared - near["approach"])[touching].max() < 1e-12


def test_finger_and_tissue_laws_give_the_same_force(whole, columns):
    """The contact of tick k uses the tissue's law of tick k - 1, and the fingertip's law."""
    contact, sent = columns["contact"], columns["tissue"]
    touching = np.flatnonzero(contact["force"][1:] > 1e-6) + 1
    assert all(m.used[1] == m.tick - 1 for m in list(whole.messages("contact"))[1:50])
    force, s1, s2 = contact["force"][touching], contact["compression"], contact["indentation"][touching]
    law = {name: values[touching - 1] for name, values in sent.items()}
    tissue = law["stiffness"] * np.maximum(s2 - law["rest_indentation"], 0.0) ** law["exponent"]
    tissue *= np.maximum(1.0 + law["damping"] * (s2 - law["previous_indentation"]) / T, 0.0)
    b, m, c = 26.2641, 1681.06, 8.0
    rate = (s1[touching] - s1[touching - 1]) / T
    finger = b / m * np.expm1(m * s1[touching]) * np.maximum(1.0 + c * rate, 0.0)
    np.testing.assert_allclose(tissue, force, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(finger, force, rtol=1e-6, atol=1e-9)


def test_the_tissue_has_the_indentation_of_the_contact(columns):
    touching = columns["contact"]["force"] > 0.0
    np.testing.assert_allclose(
        columns["tissue"]["previous_indentation"][touching],
        columns["contact"]["indentation"][touching],
        rtol=1e-7,
        atol=1e-11,
    )


def test_nodal_forces_sum_to_the_force_on_the_tissue_at_each_tick(whole, columns):
    normal, force = columns["contact"]["normal"], columns["contact"]["force"]
    expected = columns["friction"]["force"] - force[:, None] * normal
    for load, want, pressed in zip(whole.messages("spread"), expected, force, strict=True):
        assert (len(load.nodes) > 0) == (pressed > 0.0)
        assert np.abs(load.forces.sum(axis=0) - (want if pressed > 0.0 else 0.0)).max() < 1e-12


def test_friction_stays_within_its_law(columns):
    """|sigma0 z| <= mu_s, and |z'| <= v (1 + mu_s/mu_c)."""
    size = np.linalg.norm(columns["friction"]["force"], axis=1)
    speed = np.linalg.norm(columns["collision"]["slip"], axis=1)
    assert np.linalg.norm(columns["friction"]["bristle"], axis=1).max() <= 0.7 / 500.0 + 1e-12
    most = columns["contact"]["force"] * (0.7 + (1.0 * (1.0 + 0.7 / 0.5) + 0.4) * speed)
    assert (size <= most + 1e-12).all()
    across = np.abs((columns["friction"]["force"] * columns["contact"]["normal"]).sum(axis=1))
    assert across.max() < 1e-9


def test_each_touch_dissipates_work(columns):
    """Pressing with and without rubbing does not return all work of the hand."""
    contact, time = columns["contact"], columns["contact"]["time"]
    approach = contact["compression"] + contact["indentation"]
    for one in touches(time, contact["force"]):
        pressing = work(approach[one], contact["force"][one])
        assert pressing > 1e-4
        rubbing = float((columns["friction"]["force"][one] * columns["collision"]["slip"][one]).sum()) * T
        assert rubbing > 0.0
    assert columns["controller"]["energy"].min() > -5e-4


def test_at_constant_speed_friction_follows_the_normal_force(whole):
    time, normal, friction, speed = sliding(TouchStreams(whole))
    region, _ = regions(time, normal, speed)
    assert region is not None and time[region.stop - 1] - time[region.start] > 1.0
    settled = slice(region.start + 150, region.stop)  # the bristles have settled
    assert normal[settled].max() > 2.0 * normal[settled].min()
    ratio = friction[settled] / normal[settled]
    steady = 0.5 + 0.2 * np.exp(-((0.05 / 0.02) ** 2)) + 0.4 * 0.05
    assert abs(ratio.mean() - steady) < 0.01 and ratio.std() < 0.01
    assert np.corrcoef(normal[settled], friction[settled])[0, 1] > 0.99


def test_at_constant_normal_force_friction_rises_with_speed(whole):
    touch = TouchStreams(whole)
    time, normal, friction, speed = sliding(touch)
    assert beyond_dip(touch) == pytest.approx(0.05)
    _, region = regions(time, normal, speed, beyond_dip(touch))
    assert region is not None and time[region.stop - 1] - time[region.start] > 0.3
    first, last = slice(region.start, region.start + 60), slice(region.stop - 60, region.stop - 20)
    assert abs(normal[last].mean() / normal[first].mean() - 1.0) < 0.04
    assert speed[last].mean() > 1.5 * speed[first].mean()  # 50 to 80 mm/s

    def steady(part: slice) -> float:
        return float(np.mean(0.5 + 0.2 * np.exp(-((speed[part] / 0.02) ** 2)) + 0.4 * speed[part]))

    rise = friction[last].mean() / friction[first].mean()
    assert rise == pytest.approx(steady(last) / steady(first) * normal[last].mean() / normal[first].mean(), rel=0.01)
    assert rise > 1.01  # 2 % in this range of speeds


def test_a_process_for_each_node_sends_the_same_bytes(tmp_path, quick):
    assert payloads(run(tmp_path, *QUICK, duration=0.65)) == quick


@pytest.mark.parametrize("seed", range(2))
def test_any_grouping_sends_the_same_bytes(tmp_path, quick, seed):
    rng = random.Random(seed)
    names = list(NODES)
    rng.shuffle(names)
    cut = sorted(rng.sample(range(1, len(names)), 2))
    place = write_place(tmp_path, [names[: cut[0]], names[cut[0] : cut[1]], names[cut[1] :]])
    assert payloads(run(tmp_path, *QUICK, place=place, duration=0.65)) == quick


def test_the_quick_touch_rubs_and_deforms(quick):
    assert set(quick) == set(NODES) and {len(sent) for sent in quick.values()} == {650}
    assert max(map(len, quick["tissue"])) > 1000


@pytest.mark.parametrize("friction", ["true", "false"])
def test_wanted_streams_are_the_same_after_pruning(tmp_path, friction):
    sets = (*QUICK, f"scene.tissue.friction={friction}")
    full = payloads(whole := run(tmp_path, *sets, name="full", place="fused", duration=0.65))
    pruned = run(tmp_path, *sets, name="pruned", place="fused", duration=0.65, wanted=("contact",))
    fewer = payloads(pruned)
    assert ("friction" in full) == ("friction" in fewer) == (friction == "true")
    # All fields of a named stream are wanted; in the whole run no node reads the energy stored in the fingertip.
    assert [replace(m, stored=()) for m in pruned.messages("contact")] == list(whole.messages("contact"))
    assert all(len(surface.nodes) == 0 for surface in pruned.messages("tissue")), "no node reads the displacement"


def test_the_frictionless_scene_equals_the_scene_without_friction(tmp_path):
    from palpate.launch.load.files import SCENES

    scene = SCENES / "frictionless.yaml"
    by_scene = payloads(run(tmp_path, *QUICK, name="scene", place="fused", duration=0.3, scene=scene))
    by_hand = payloads(run(tmp_path, *QUICK, "scene.tissue.friction=false", name="hand", place="fused", duration=0.3))
    assert by_scene == by_hand and "friction" not in by_scene
