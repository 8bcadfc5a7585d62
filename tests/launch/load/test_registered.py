"""Classes that other distributions register as entry points are listed, suggested and tried like shipped ones."""

import json
import os
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

RUNNER = Path(__file__).parents[2] / "support" / "more_rooms" / "commands.py"
FILES = {
    "lab/__init__.py": "",
    "lab/tissue.py": """
        from palpate.messages import Contact
        from palpate.nodes import Node
        from palpate.nodes.deformation.mass_spring import MassSpring
        from lab.signals import Glow


        class Foam(MassSpring):
            \"\"\"A sponge.\"\"\"

            rank = 2


        class Lamp(Node):
            \"\"\"Shines where it is pressed.\"\"\"

            def step(self, contact: Contact) -> Glow:
                return Glow(power=contact.force)
    """,
    "lab/signals.py": """
        from typing import Annotated

        from palpate.messages import Message


        class Glow(Message):
            \"\"\"How bright it is.

            power  [W] ()  of the lamp
            \"\"\"

            power: Annotated[float, "W"]
    """,
    "lab/broken.py": "import nothing_that_is_there",
    "lab/odd.py": """
        from palpate.nodes import Node


        class Odd(Node):
            def step(self, contact: int) -> int:
                return contact
    """,
    "lab-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n",
    "lab-1.0.dist-info/entry_points.txt": """
        [palpate.nodes]
        tissue = lab.tissue
        broken = lab.broken
        odd = lab.odd

        [palpate.messages]
        signals = lab.signals
    """,
}
COMMANDS = {
    "nodes": ["list", "nodes", "--json"],
    "shown": ["list", "nodes"],
    "message": ["list", "messages", "Glow", "--json"],
    "near": ["check", "kidney", "--set", "tissue.use=lab.tissue.Foan"],
    "check": ["check", "kidney", "--set", "tissue.use=lab.tissue.Foam"],
}


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """Exit code and output of each command with an installed distribution `lab`."""
    folder = tmp_path_factory.mktemp("site")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(dedent(text).lstrip())
    done = subprocess.run(
        [sys.executable, RUNNER], input=json.dumps(list(COMMANDS.values())), capture_output=True, text=True, cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))},
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return dict(zip(COMMANDS, json.loads(done.stdout), strict=True))


def test_registered_nodes_are_in_the_catalogue(printed):
    code, text = printed["nodes"]
    entries = {entry["use"]: entry for entry in json.loads(text)["nodes"]}
    assert code == 0 and entries["lab.tissue.Lamp"]["about"] == "Shines where it is pressed."
    assert entries["lab.tissue.Lamp"]["outputs"] == ["Glow"] and "deformation.MassSpring" in entries
    assert "lab.tissue.MassSpring" not in entries, "a class that a module only imports is not listed"


def test_a_broken_distribution_is_reported_and_the_others_are_listed(printed):
    missing = json.loads(printed["nodes"][1])["missing"]
    assert "nothing_that_is_there" in missing["lab.broken"] and "'lab.odd.Odd' is not well formed" in missing["lab.odd"]
    code, text = printed["shown"]
    assert code == 0 and "lab.broken cannot be loaded" in text and "deformation.Rigid" in text


def test_a_registered_message_is_listed_with_its_units(printed):
    code, text = printed["message"]
    (kind,) = json.loads(text)["messages"]
    assert code == 0 and kind["fields"][0]["unit"] == "W"


def test_registered_classes_are_suggested_and_run_by_their_full_name(printed):
    code, text = printed["near"]
    assert code == 2 and "lab.tissue.Foam" in text
    assert printed["check"][0] == 0


def test_a_registered_body_with_a_rank_is_tried_among_the_bodies(tmp_path, monkeypatch):
    (tmp_path / "sponge-1.0.dist-info").mkdir()
    (tmp_path / "sponge-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: sponge\nVersion: 1.0\n")
    (tmp_path / "sponge-1.0.dist-info" / "entry_points.txt").write_text("[palpate.nodes]\nsponge = sponge\n")
    (tmp_path / "sponge.py").write_text(
        dedent("""
        from palpate.nodes.deformation.mass_spring import MassSpring


        class Sponge(MassSpring):
            rank = 2
    """)
    )
    monkeypatch.syspath_prepend(tmp_path)
    from palpate.nodes.deformation import bodies

    assert list(bodies()).index("sponge.Sponge") == 2, "after ReducedFE and BeamBundle, before MassSpring"
