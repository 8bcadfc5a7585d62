"""A stack of three organs from the scene's list `organs`: each contact is solved alone, with the others' forces of the
last step, and at rest all of them together are in equilibrium."""

import numpy as np
import pytest
from pytest import approx
from scipy.optimize import nnls
from streams import payloads

from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Load, Surface, unpack
from palpate.messages.contact import OrganContact
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

QUICK = (
    *(f"scene.{organ}.surface.vertices=2000" for organ in ("upper", "middle", "kidney")),
    "scene.hand.path=[{to: [0, 0, 0.132], time: 0.2}, {hold: 0.25}, {to: [0, 0, 0.158], time: 0.1}]",
)  # fmt: skip
HELD = 440  # tick at which the finger has rested for 12 retardation times


@pytest.fixture(scope="module")
def stacked(tmp_path_factory):
    path = tmp_path_factory.mktemp("stack") / "stack.mcap"
    launch = find("stack").but(duration=0.6, record=path, place="fused", overrides=QUICK)
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return launch, Recording(path)


def openings(between, which, load):
    """Opening [m] (m) of the candidates of a contact by a load on one of its bodies, "first" or "second"."""
    side = {"first": "one", "second": "two"}[which]
    held = between._held
    out = np.zeros(len(held["pair.gap"]))
    for node, force in zip(load.nodes, load.forces, strict=True):
        for corner, weight in zip(held[f"{side}.corners"][node], held[f"{side}.weights"][node], strict=True):
            rows = held[f"{side}.response"][:, 3 * corner : 3 * corner + 3]
            out += weight * np.einsum("x,bxl->bl", force, rows).ravel()[: len(out)]
    return out


def unit_loads(between, which):
    """The load on a body by a unit force on each candidate."""
    side, sign = {"first": ("one", 1.0), "second": ("two", -1.0)}[which]
    held = between._held
    begins, normals = held[f"{side}.begins"], held["normals"]
    for i in range(len(normals)):
        part = slice(begins[i], begins[i + 1])
        nodes, weights = held[f"{side}.vertices"][part].astype(np.int32), held[f"{side}.shares"][part]
        yield Load(nodes=nodes, forces=sign * np.outer(weights, normals[i]), foot=(0, 0, 0), normal=(0.0, 0.0, 1.0))


def test_at_rest_all_contacts_together_are_in_equilibrium(stacked):
    """Forces of both contacts against one complementarity problem of all candidates, with the coupling through the
    middle ball, which non-negative least squares solves."""
    launch, recording = stacked
    streams, planned = payloads(recording), plan(launch.load())
    upper, lower = (planned.make(name) for name in ("between-upper-middle", "between-middle-kidney"))
    for each in (upper, lower):
        each.start()
    press = unpack(streams["spread-upper"][HELD], Load)
    sizes = [len(each._held["pair.gap"]) for each in (upper, lower)]
    whole = np.zeros((sum(sizes), sum(sizes)))
    for each, at in ((upper, slice(0, sizes[0])), (lower, slice(sizes[0], None))):
        whole[at, at] = each._held["pair.first"] + each._held["pair.second"]
    for j, load in enumerate(unit_loads(upper, "second")):
        whole[sizes[0] :, j] = openings(lower, "first", load)
    across = np.transpose([openings(upper, "second", load) for load in unit_loads(lower, "first")])
    assert across == approx(whole[sizes[0] :, : sizes[0]].T, rel=1e-6, abs=1e-9)  # E. Betti
    whole[: sizes[0], sizes[0] :] = across
    gap = np.concatenate([upper._held["pair.gap"] + openings(upper, "first", press), lower._held["pair.gap"]])
    factor = np.linalg.cholesky(whole)
    forces = nnls(factor.T, -np.linalg.solve(factor, gap), maxiter=20_000)[0]
    found = [unpack(streams[n][HELD], OrganContact) for n in ("between-upper-middle", "between-middle-kidney")]
    assert found[1].force > 0.05
    assert found[0].force == approx(forces[: sizes[0]].sum(), rel=5e-3)
    assert found[1].force == approx(forces[sizes[0] :].sum(), rel=5e-3)


def test_the_finger_presses_through_all_organs_and_everything_recovers(stacked):
    streams = payloads(stacked[1])
    for name in ("between-upper-middle", "between-middle-kidney"):
        between = [unpack(m, OrganContact) for m in streams[name]]
        assert max(b.generated for b in between) < 1e-12 and min(b.gap for b in between) > -1e-9
        assert between[-1].force == 0.0
    assert unpack(streams["kidney"][HELD], Surface).previous_indentation > 1e-4
    assert not any(unpack(m, Contact).force for m in streams["contact-kidney"])


def test_it_replays_bit_for_bit(stacked):
    report = verify(stacked[1], plan_of(stacked[1]), tolerance=0.0)
    assert report.ok and report.complete, report.first
