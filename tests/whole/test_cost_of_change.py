"""An extension takes one file: a friction law, a material, a body, a device, a message, a command.

Each file is written into a copy of its folder, and no other file changes; then the command line finds, checks, runs,
records, replays and exports all of them together.
"""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest
from added_laws import DAHL, GENT

MORE_ROOMS = Path(__file__).parents[1] / "support" / "more_rooms"

ADDED = {
    "physics/friction/dahl.py": DAHL,
    "physics/materials/gent.py": GENT,
    "nodes/deformation/putty.py": '''
        """A body that stays where it was pressed to."""

        from typing import Annotated

        import numpy as np

        from palpate.messages import Load, Surface
        from palpate.nodes import Node


        class Putty(Node):
            """Its indentation grows with force and time, and never recovers."""

            mobility: Annotated[float, "m/(N s)"] = 2e-3
            plate: Annotated[float, "N/m"] = 2e3

            def start(self):
                self.depth = 0.0

            def step(self, load: Load, *, dt: float) -> Surface:
                force = max(-float(load.forces.sum(axis=0) @ np.array(load.normal)), 0.0)
                self.depth += self.mobility * force * dt
                return Surface(
                    nodes=[], displacement=np.zeros((0, 3)), stiffness=self.plate, exponent=1.0, damping=0.0,
                    rest_indentation=self.depth, previous_indentation=self.depth + force / self.plate, step=dt,
                )
    ''',
    "nodes/device/crank.py": '''
        """A crank that lowers the finger, with its driver."""

        import time

        from palpate.drivers.guard import DeviceSample
        from palpate.drivers.limits import Limits
        from palpate.messages import DeviceState, Force
        from palpate.nodes.device.hardware import Hardware, state


        class Driver:
            """3 mm down in 0.1 s, and back in the next 0.1 s."""

            limits = Limits(command=2.0, power=2.0, speed=1.0)
            size = 3

            def open(self):
                self.begun = time.monotonic()

            def cycle(self, command):
                time.sleep(1e-3)
                way = abs(0.1 - (time.monotonic() - self.begun) % 0.2) / 0.1
                return DeviceSample(time.monotonic_ns(), position=(0.0, 0.0, 0.107 + 0.003 * way))

            def close(self):
                pass


        class Crank(Hardware):
            """A finger on a crank."""

            def driver(self):
                return Driver()

            def step(self, force: Force | None, *, dt: float) -> DeviceState:
                return state(self.talk(force.force if force is not None else (0.0, 0.0, 0.0), dt))
    ''',
    "messages/warmth.py": '''
        """Message of a skin that feels warm."""

        from typing import Annotated

        from palpate.messages.base import Message


        class Warmth(Message):
            """How warm rubbing makes the skin.

            power  [W] ()  of friction
            """

            power: Annotated[float, "W"]
    ''',
    "cli/commands/greet.py": '''
        """`palpate greet`: a friendly word."""

        import typer

        EXAMPLE = "palpate greet Ada"


        def greet(name: str) -> None:
            """Greet a person."""
            typer.echo(f"Good day, {name}.")
    ''',
}
"""Added files, by their path in the repository."""
OWN = {
    "skin.py": '''
        from palpate.messages import Friction, Proximity, Warmth
        from palpate.nodes import Node


        class Skin(Node):
            """Feels its friction."""

            def step(self, friction: Friction, proximity: Proximity) -> Warmth:
                return Warmth(power=sum(f * v for f, v in zip(friction.force, proximity.slip)))
    ''',
    "rub.yaml": """
        extends: cartesian
        nodes:
          device: {use: device.Crank, port: emulator, ramp: 0.01, in: {force: controller}}
          friction: {use: friction.Dahl, mu: 0.3, in: {contact: contact, proximity: collision}}
          tissue: {use: deformation.Putty, in: {load: spread}}
          skin: {use: skin.Skin, in: {friction: friction, proximity: collision}}
    """,
}
"""Files that a user of the extensions writes."""
COMMANDS = {
    "greet": ["greet", "Ada"],
    "nodes": ["list", "nodes", "--json"],
    "messages": ["list", "messages", "Warmth", "--json"],
    "laws": ["list", "laws", "--json"],
    "check": ["check", "rub.yaml"],
    "wrong": ["check", "rub.yaml", "--set", "friction.mu=-1"],
    "run": ["run", "rub.yaml", "--fused", "--duration", "0.5", "--record", "rub.mcap", "--quiet"],
    "replay": ["replay", "rub.mcap", "--check"],
    "info": ["info", "rub.mcap", "--json"],
    "csv": ["export", "rub.mcap", "--to", "csv", "--out", "tables"],
    "foxglove": ["export", "rub.mcap", "--to", "foxglove", "--out", "rub-json.mcap"],
}


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """The output of each command, and the folder in which they ran."""
    rooms, here = tmp_path_factory.mktemp("rooms"), tmp_path_factory.mktemp("here")
    for files, folder in ((ADDED, rooms), (OWN, here)):
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(dedent(text).lstrip())
    path = os.pathsep.join([str(MORE_ROOMS), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, MORE_ROOMS / "commands.py"], input=json.dumps(list(COMMANDS.values())), cwd=here, check=False,
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path, "MORE_ROOMS": str(rooms)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return dict(zip(COMMANDS, json.loads(done.stdout), strict=True)), here


def answer(printed, name):
    code, text = printed[0][name]
    assert code == 0, text
    return text


def test_a_command_takes_one_file(printed):
    assert answer(printed, "greet") == "Good day, Ada.\n"


def test_the_catalogue_lists_the_law_the_body_and_the_device(printed):
    entries = {entry["use"]: entry for entry in json.loads(answer(printed, "nodes"))["nodes"]}
    assert [s["unit"] for s in entries["friction.Dahl"]["settings"]] == ["1", "1/m"]
    assert entries["deformation.Putty"]["outputs"] == ["Surface"]
    assert entries["device.Crank"]["outputs"] == ["DeviceState"]


def test_a_message_is_listed_with_units_and_descriptions(printed):
    (kind,) = json.loads(answer(printed, "messages"))["messages"]
    assert kind["fields"] == [{"name": "power", "unit": "W", "shape": [], "about": "of friction", "required": True}]


def test_the_table_of_laws_lists_the_material(printed):
    rows = {row["law"]: row for row in json.loads(answer(printed, "laws"))["laws"]}
    assert "J^(-2/3) I1 - 3" in rows["gent"]["text"] and rows["gent"]["shear Pa"] == pytest.approx(1e4 / 2.8)


def test_their_graph_is_checked_with_units_and_limits(printed):
    answer(printed, "check")
    code, text = printed[0]["wrong"]
    assert code == 2 and "'friction', setting 'mu'" in text and "-1" in text, text


def test_they_run_together_and_their_recording_replays_bit_for_bit(printed):
    answer(printed, "run")
    answer(printed, "replay")
    streams = {stream["name"]: stream["type"] for stream in json.loads(answer(printed, "info"))["streams"]}
    assert streams["skin"] == "Warmth"


def test_their_messages_are_exported_with_units(printed):
    answer(printed, "csv")
    answer(printed, "foxglove")
    with (printed[1] / "tables" / "tissue.csv").open() as file:
        rows = list(csv.DictReader(file))
    depths = [float(row["rest_indentation [m]"]) for row in rows]
    assert depths == sorted(depths) and depths[-1] > 0.0
    with (printed[1] / "tables" / "skin.csv").open() as file:
        assert "power [W]" in next(csv.reader(file))
