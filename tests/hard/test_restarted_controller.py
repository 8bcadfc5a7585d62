"""A controller that is restarted in a press, and commands that do not arrive, by the rules of the real clock.

Random faults that coincide or that the motion causes: `tests/studies/test_fault_search.py`.
"""

from lossy_touch import TAP, TOUCH, feel

from palpate.launch.load.launchfile import find
from palpate.nodes.controller import Haptic
from palpate.studies.faults.chain import nothing
from palpate.studies.faults.touch import Felt

ENERGY = 1e-3  # [J]


def test_a_controller_restarted_during_a_press_starts_without_force(chain):
    """It knows neither the force nor the energy before; it used to jump to the full force, by 1.3 N in a tick."""
    run = chain(find("kidney").but(overrides=TOUCH))
    forces: list[float] = []

    def each(tick: int, felt: Felt) -> None:
        if tick in (250, 290):
            (run.die if tick == 250 else run.revive)("controller")
        forces.append(felt.hand)

    felt = feel(run, nothing, each)
    assert forces[250] > 1.0 and forces[290] == 0.0
    assert all(force <= Haptic.limit / Haptic.ramp * 1e-3 * ticks for ticks, force in enumerate(forces[290:391]))
    assert felt.energy >= -ENERGY


def test_force_that_the_device_did_not_apply_adds_no_energy_credit(chain):
    """The commands of 15 ms of a tap are lost: the device holds 0.2 N, the controller computes up to 4 N."""
    run = chain(find("kidney").but(overrides=TAP))
    controller = run.slot("controller").node
    seen: list[tuple[float, float]] = []

    def each(tick: int, felt: Felt) -> None:
        seen.append((1e3 * controller.own["before"], 1e3 * felt.taken))

    feel(run, lambda stream, reader, tick: (stream, reader) == ("statics", "device") and 22 <= tick < 37, each)
    assert max(observed - taken for observed, taken in seen[45:300]) < 1.0
