"""A graph as an FMU, a unit for co-simulation after FMI 3.0 (docs/fmu.md): written by `palpate build fmu GRAPH`.

The unit holds the graph as it was resolved, and a script that PythonFMU calls; palpate itself must be installed where
it runs. It steps the graph in the process of the importing tool, on simulated time.
"""

import json
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import find
from palpate.messages import fields
from palpate.nodes.base import settings
from palpate.nodes.device.steered import Steered
from palpate.physics.errors import ArgumentError
from palpate.physics.extras import missing
from palpate.stepping import Stepper, Tick, planned

PLAN = "plan.json"
AXES = "xyz"
SCRIPT = '''"""A graph of palpate; see launch/fmu.py there."""
from palpate.launch.fmu import GraphUnit
from pythonfmu3 import Fmi3Slave, Float64, Fmi3Causality, Fmi3Initial, Fmi3Variability
from pythonfmu3.unit import Unit


class {name}(GraphUnit, Fmi3Slave):
    def declare(self, name, unit, causality, getter, setter=None):
        fixed, given = causality == "parameter", causality in ("input", "independent")
        self.register_units([Unit(unit)])
        self.register_variable(Float64(
            name, unit=unit, causality=Fmi3Causality[causality], getter=getter, setter=setter,
            variability=Fmi3Variability.fixed if fixed else Fmi3Variability.continuous,
            initial=None if given else Fmi3Initial.exact if fixed else Fmi3Initial.calculated,
        ), nested=False)
'''


def export_fmu(graph: str, out: Path | None, sets: Sequence[str]) -> Path:
    """Write GRAPH.fmu, or `out`. GraphError, ArgumentError: what is wrong with the graph, or PythonFMU is missing."""
    try:
        from pythonfmu3.builder import FmuBuilder
    except ImportError as error:
        raise ArgumentError(missing("an FMU", error.name, "fmu")) from None
    whole = planned(find(graph).but(overrides=sets))
    Stepper(whole)  # which refuses what cannot be stepped
    name = "Graph" + re.sub(r"\W", "_", Path(graph).stem).title().replace("_", "")
    out = out or Path(f"{Path(graph).stem}.fmu")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / PLAN).write_text(json.dumps(whole.to_spec()), encoding="utf-8")
        script = folder / f"{name.lower()}.py"  # a name of its own: a process may run units of several graphs
        script.write_text(SCRIPT.format(name=name), encoding="utf-8")
        built = FmuBuilder.build_FMU(script, dest=folder / "built", project_files=[folder / PLAN])
        out.write_bytes(built.read_bytes())
    return out


class GraphUnit:
    """What the unit does; mixed into PythonFMU's slave, which has `resources` and `declare`.

    Outputs     every number, and vector of three, that a node sends: `contact.force`, `controller.force.x`
    Parameters  every number among the settings, before the run: `set.tissue.stiffness`
    Inputs      of each `device.Steered`, the velocity of the hand's goal [m/s]: `device.velocity.x`
    """

    resources: str
    declare: Callable[..., None]

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        spec = json.loads((Path(self.resources) / PLAN).read_text(encoding="utf-8"))
        self._stepper = Stepper(Plan.from_spec(spec))  # a unit is a program: it may name classes of anybody
        self._changes: dict[str, dict[str, Any]] = {}
        self._speeds: dict[str, list[float]] = {}
        self._tick: Tick | None = None
        self.declare("time", "s", "independent", lambda: self._tick.time if self._tick else 0.0)
        for name in self._stepper.plan.order:
            self._declare_node(name)

    def _declare_node(self, name: str) -> None:
        node = self._stepper.node(name)
        for key, setting in settings(type(node)).items():
            if type(getattr(node, key)) is float:
                self.declare(f"set.{name}.{key}", setting.unit, "parameter", *self._parameter(name, key))
        if isinstance(node, Steered):
            self._speeds[name] = [0.0, 0.0, 0.0]
            for place, letter in enumerate(AXES):
                self.declare(f"{name}.velocity.{letter}", "m/s", "input", *self._input(name, place))
        for stream, field, axis in self._numbers(name):
            letter = "" if axis is None else f".{AXES[axis]}"
            self.declare(f"{stream}.{field.name}{letter}", field.unit, "output", self._output(stream, field.name, axis))

    def _numbers(self, name: str) -> Iterator[tuple[str, Any, int | None]]:
        for stream, kind in self._stepper.sends(name):
            for field in fields(kind):
                if field.type is float:
                    yield stream, field, None
                elif field.dtype is None and field.shape == (3,):
                    yield from ((stream, field, axis) for axis in range(3))

    def _parameter(self, name: str, key: str) -> tuple[Callable[[], float], Callable[[float], None]]:
        node, changes = self._stepper.node(name), self._changes

        def put(value: float) -> None:
            changes.setdefault(name, {})[key] = value

        return lambda: changes.get(name, {}).get(key, getattr(node, key)), put

    def _input(self, name: str, axis: int) -> tuple[Callable[[], float], Callable[[float], None]]:
        speed = self._speeds[name]
        return lambda: speed[axis], lambda value: speed.__setitem__(axis, value)

    def _output(self, stream: str, field: str, axis: int | None) -> Callable[[], float]:
        def get() -> float:
            message = self._tick[stream] if self._tick else None
            if message is None:
                return 0.0
            value: Any = getattr(message, field)
            return float(value if axis is None else value[axis])

        return get

    def exit_initialization_mode(self) -> None:
        """Start the nodes and run the tick at time 0."""
        self._stepper.start()
        self._stepper.restart(self._changes)
        self._tick = self._stepper.tick()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Go on by a step: whole ticks of the graph. ArgumentError: another step."""
        assert self._tick is not None  # FMI initializes before it steps
        end = (current_time + step_size) * self._stepper.rate
        count = round(end) - self._tick.number
        if abs(end - round(end)) > 1e-6 * max(1.0, end) or count < 1:
            raise ArgumentError(f"step to {current_time + step_size} s: expected ticks of 1/{self._stepper.rate:g} s")
        for name, speed in self._speeds.items():
            node = self._stepper.node(name)
            assert isinstance(node, Steered)
            node.steer(speed)
        for _ in range(count):
            self._tick = self._stepper.tick()
        return True

    def terminate(self) -> None:
        """Stop the nodes."""
        self._stepper.stop()
