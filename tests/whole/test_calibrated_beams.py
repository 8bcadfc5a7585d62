"""BeamBundle in the kidney graph has the forces of ReducedFE, on motions that are not in the fit of its constants."""

import numpy as np
import pytest

from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.records.compare import compare
from palpate.studies.search import record_touch

BEAMS = "tissue.use=deformation.BeamBundle"
PARTS = {  # motion, starting where the previous one ends, and its duration [s]
    "fast press": ("{to: [0.012, -0.004, 0.097], time: 0.15}", 0.15),
    "hold": ("{hold: 0.2}", 0.2),
    "release": ("{to: [0.012, -0.004, 0.114], time: 0.15}", 0.15),
    "to another place": ("{to: [-0.02, 0.003, 0.112], time: 0.25}", 0.25),
    "slow press": ("{to: [-0.02, 0.003, 0.0985], time: 0.7}", 0.7),
    "slide at 20 mm/s": ("{to: [-0.014, 0.003, 0.097], time: 0.3, shape: linear}", 0.3),
    "slide at 80 mm/s": ("{to: [0.006, 0.003, 0.0955], time: 0.25, shape: linear}", 0.25),
    "slide at 160 mm/s": ("{to: [-0.018, 0.003, 0.0965], time: 0.15, shape: linear}", 0.15),
    "lift": ("{to: [-0.018, 0.003, 0.112], time: 0.3}", 0.3),
}
FASTEST = "fast press"


@pytest.fixture(scope="module")
def forces(tmp_path_factory):
    """Contact force [N] of ReducedFE and of the beams at each tick (t,2), for a motion outside the fit."""
    path = f"[{', '.join(motion for motion, _ in PARTS.values())}]"
    sets = ("scene.hand.begin=[0.012, -0.004, 0.114]", f"scene.hand.path={path}", "scene.surface.vertices=4000")
    launch = find("kidney").but(duration=sum(time for _, time in PARTS.values()), overrides=sets)
    recording = record_touch(launch, tmp_path_factory.mktemp("beams") / "touch.mcap")
    printed = []
    compare(
        recording, [[BEAMS]], reference=["tissue.use=deformation.ReducedFE"],
        on_tick=lambda players: printed.append([player.last("contact")[0].force for player in players]),
    )  # fmt: skip
    return np.array(printed)


@pytest.mark.long
def test_presses_holds_and_slides_have_the_force_of_the_reference(forces):
    peak = forces[:, 0].max()
    assert 1.5 < peak < 4.0
    off = np.abs(forces[:, 1] - forces[:, 0]) / peak
    assert np.sqrt(np.mean(off**2)) < 0.05
    begin, by_part = 0, {}
    for name, (_, time) in PARTS.items():
        own = off[begin : begin + round(1e3 * time)]
        begin += round(1e3 * time)
        by_part[name] = float(np.sqrt(np.mean(own**2)))
    assert max(error for name, error in by_part.items() if name != FASTEST) < 0.05, by_part
    assert by_part[FASTEST] < 0.1, "one relaxation time for presses and slides is too short for the fastest press"


@pytest.mark.parametrize("graph, node", [("kidney", "tissue"), ("organs", "liver"), ("fingertip", "tissue")])
def test_a_scene_without_constants_for_the_beams_is_noted(graph, node):
    notes = load(graph, overrides=[f"{node}.use=deformation.BeamBundle"]).notes
    printed = [note for note in notes if "human fingertip" in note and "palpate fit body" in note]
    assert len(printed) == (graph == "fingertip") and all("layers, moduli, relaxations" in note for note in printed)


def test_another_tissue_scales_the_moduli_of_the_kidney():
    kidney, soft = (load("kidney", overrides=[BEAMS, *more]) for more in ([], ["scene.tissue=liver-human"]))
    here, there = kidney.nodes["tissue"].settings, soft.nodes["tissue"].settings
    factor = 4.0 * 2090.0 / (19e3 / (1.0 - 0.45**2))  # E/(1 - nu²) = 4 G for nu = 0.5
    assert there["moduli"] == pytest.approx([factor * modulus for modulus in here["moduli"]], rel=5e-3)
    assert [there[name] for name in ("layers", "relaxations")] == [here[name] for name in ("layers", "relaxations")]
    assert not any("human fingertip" in note for note in soft.notes)
    assert load("kidney").notes == (), "MassSpring has separate constants"
