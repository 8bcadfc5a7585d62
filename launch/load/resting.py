"""Notes about friction on which a finger in a simulated hand may not come to rest (physics/device/stick.py)."""

from collections.abc import Iterable, Iterator
from typing import Any

from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import DeviceState, Message, Pose, Proximity

LOAD = 1.0  # [N] normal force of the check
NOISE = 20e-3  # [N] predicted RMS above which a note is made: about 30 mN in a run, of which 0.7 are predicted
GRIP = ("mass", "damping", "hand_stiffness", "hand_damping", "resolution")  # settings of a held grip
STIFFEST = 1e5  # [N/m]


def restless(nodes: dict[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Iterator[str]:
    """A note for each node of friction whose stick oscillates against the hand that holds a device of this graph.

    It needs a law with `stick`, and a device with the settings of a held grip. A network in the loop has other notes.
    """
    senders: dict[tuple[str, type[Message]], str] = {}
    for wire in wires:
        for kind in (Proximity, Pose, DeviceState):
            if issubclass(wire.port.type, kind):
                senders[wire.consumer, kind] = wire.producer
    for name, spec in nodes.items():
        law = getattr(spec.cls, "law", None)
        if not hasattr(law, "stick"):
            continue
        path = [name]
        for kind in (Proximity, Pose, DeviceState):
            path.append(senders.get((path[-1], kind), ""))
        *_, finger, device = path
        if device in nodes and finger in nodes:
            yield from _note(name, spec, law, nodes[finger].settings, nodes[device].settings, rate)


def _note(
    name: str, spec: NodeSpec, law: Any, finger: dict[str, Any], device: dict[str, Any], rate: float
) -> Iterator[str]:
    from palpate.physics.device.stick import HeldDevice, oscillation, resting_spring  # needs numpy

    mass, drag, arm, damping, step = (device.get(each) for each in GRIP)
    settings = [spec.settings.get(each) for each in law._fields]
    if mass is None or drag is None or arm is None or damping is None or step is None or None in settings:
        return  # no hand, or a setting with a fault
    samples, count = device.get("delay") or 0, finger.get("resolution") or 0.0
    held = HeldDevice(mass, arm, drag + damping, (samples + 0.5) / rate, count if step > 0.0 else 0.0)
    spring, damper = law.stick(law(*settings), LOAD)
    noise = oscillation(held, spring, damper)
    if noise <= NOISE:
        return
    setting = spec.cls.spring  # type: ignore[attr-defined]
    most = float(f"{0.95 * resting_spring(held, damper, STIFFEST) / spring * spec.settings[setting]:.2g}")
    cure = f"it rests with `--set {name}.{setting}={most:g}`" if most > 0.0 else "no spring of friction rests here"
    size = f"by {1e3 * noise:.2g} mN (RMS)" if noise < 1.0 else "until it slips"
    counts = f", counts of {1e6 * count:.3g} um" if held.step else ""
    yield (
        f"{name}: a finger that presses with {LOAD:g} N may not come to rest. Its friction sticks like a spring of "
        f"{spring:.3g} N/m, which oscillates {size} against a hand of {mass:.3g} kg, {arm:.3g} N/m and "
        f"{damping:.3g} N s/m at a delay of {1e3 * held.delay:.3g} ms{counts}; {cure}"
    )
