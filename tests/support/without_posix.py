"""Uses palpate as a library in a process that lacks what only POSIX has: start it with `hidden` on the path.

python without_posix.py GRAPH PART...
"""

import os
import sys
import warnings
from pathlib import Path

import numpy as np

import palpate


def runs(graph, folder):
    """Run, open, step, verify and export, from and to names with spaces, umlauts and Windows' line ends."""
    from palpate.launch.load.launchfile import LaunchFile
    from palpate.launch.run.execute import execute
    from palpate.records.export import export
    from palpate.records.player import plan_of
    from palpate.records.reader import Recording
    from palpate.records.verify import verify

    run = palpate.run(graph, record=folder / "run.mcap", duration=0.12)
    peak = run.contact.force.max()
    assert palpate.open(run.path).contact.force.max() == peak > 0.05
    assert sum(tick.contact.force > 0.0 for tick in palpate.steps(graph, duration=0.12)) > 20
    report = verify(Recording(run.path), plan_of(Recording(run.path)))
    assert report.ok and report.verified, report.first
    for form in ("csv", "foxglove"):
        assert all(path.stat().st_size > 0 for path in export(Recording(run.path), form))
    lines = f"extends: '{graph.resolve()}'\nnodes:\n  tissue: {{stiffness: 4000}} # für später\n"
    for end in ("\n", "\r\n"):
        file = folder / f"Graph {len(end)} für Übung.yaml"
        file.write_bytes(lines.replace("\n", end).encode())
        stiffer = execute(LaunchFile(graph=file, duration=0.12, place="fused", record=folder / f"{len(end)}.mcap"))
        assert stiffer.ok
    one, two = (palpate.open(folder / f"{length}.mcap").contact.force for length in (1, 2))
    assert (one == two).all() and one.max() > peak
    names = [path.name.casefold() for path in folder.rglob("*")]
    assert len(names) == len(set(names)), "two files of a folder differ only in case"


def many(graph, folder):
    """Ensembles, with and without a file, environments and a study."""
    from palpate.gym.touch import Touch
    from palpate.gym.vector import VectorTouch

    force = {"tissue.stiffness": [2e3, 4e3]}
    ensemble = palpate.Ensemble(graph, lanes=2, over=force, duration=0.1)
    soft, hard = ensemble.run(quiet=True)["contact.force"].max(axis=1)
    assert 0.05 < soft < hard
    kept = palpate.Ensemble(graph, lanes=2, over=force, duration=0.1).run(quiet=True, out=folder / "Läufe")
    assert (kept["contact.force"].max(axis=1) == [soft, hard]).all()
    env = Touch(graph, duration=1.0)
    env.reset(seed=1)
    for _ in range(8):
        seen = env.step(np.array([0.0, 0.0, -0.03], np.float32))[0]
    assert np.isfinite(seen["force"]).all()
    env.close()
    several = VectorTouch(Touch, 2, graph=graph, duration=1.0)
    several.reset(seed=1)
    several.step(np.tile(np.array([0.0, 0.0, -0.03], np.float32), (2, 1)))
    several.close()
    study = palpate.Study(graph, {"tissue.stiffness": [2e3, 4e3]}, ["peak contact.force"])
    assert len(study.points) == 2


def shown(graph, folder):
    """Fits, errors of the bodies, pictures, and the page of a recording."""
    from palpate.models.fit.curve_fit import fit_curve
    from palpate.physics.contact.force_models import MODELS
    from palpate.views.page.reel import Reels
    from palpate.views.page.server import PageServer

    fitted = fit_curve(MODELS["linear"], np.array([0.0, 1e-3, 2e-3, 3e-3]), np.array([0.1, 0.6, 1.1, 1.6]))
    assert np.allclose(fitted.parameters, [500.0, 0.1])
    run = palpate.run(graph, record=folder / "run.mcap", duration=0.12)
    page = PageServer(Reels([run.path]))
    assert page.address.startswith("http://127.0.0.1:")
    page.close()


def apart(graph, folder):
    """Nodes in processes, connected by TCP with a key: the same bytes as in one process, and nothing for a stranger."""
    import zmq
    from same_bytes import digests

    from palpate.launch.load.launchfile import LaunchFile
    from palpate.launch.run.execute import execute

    place = folder / "place.yaml"
    loop = "device, finger, collision, contact, friction, controller, statics"
    place.write_text(f"loop: {{nodes: [{loop}]}}\nbody: {{nodes: [tissue, spread]}}\n")
    launch = LaunchFile(graph=graph, duration=0.12, place=place)
    heard, addresses = [], set()
    with zmq.Context() as context:
        stranger = context.socket(zmq.SUB)
        stranger.set(zmq.LINGER, 0)
        stranger.subscribe(b"")

        def watch(launcher):
            for worker in launcher.members.values():
                for address in sum(
                    worker.endpoints.values(), [launcher._control.sockets.control, launcher._control.sockets.reports]
                ):
                    if address not in addresses:
                        addresses.add(address)
                        stranger.connect(address)
            heard.extend([stranger.recv()] if stranger.poll(0) else [])

        outcome = execute(launch.but(record=folder / "apart.mcap"), watch=watch)
        assert outcome.ok, outcome.result.deaths
        paced = execute(launch.but(clock="real", duration=1.0, record=folder / "real.mcap"), watch=watch)
        assert paced.ok and paced.result.ticks == 1000, paced.result.deaths
        stranger.close()
    assert execute(launch.but(place="fused", record=folder / "fused.mcap")).ok
    assert digests(folder / "apart.mcap") == digests(folder / "fused.mcap")
    assert len(addresses) >= 12 and all(address.startswith("tcp://127.0.0.1:") for address in addresses)
    assert not heard, heard


def computed(graph, folder):
    """Work in other processes: the points of a study with a time limit, and a missing basis."""
    from palpate.launch.load.organ_file import OrganFile

    over = {"tissue.stiffness": [2e3, 4e3]}
    study = palpate.Study(graph, over, ["peak contact.force"], duration=0.1, limit=60.0)
    study.run(folder / "Studie", workers=1)
    soft, hard = study.table()["peak contact.force"]
    assert 0.05 < soft < hard
    trimesh = __import__("pytest").importorskip("trimesh")
    trimesh.creation.icosphere(2, 60.0).export(folder / "Kügelchen 1.stl")
    body = {"use": "deformation.ReducedFE", "coarse": 60}
    given = {"organ": OrganFile(folder / "Kügelchen 1.stl", "mm"), "tissue": body, "duration": 0.6}
    assert palpate.run("kidney", record=folder / "ball.mcap", **given).contact.force.max() > 0.05


def commands(graph, folder):
    """Commands that draw, compare, export and fit."""
    from typer.testing import CliRunner

    from palpate.cli.__main__ import app

    os.chdir(folder)
    file = "Niere 1 ü.mcap"
    for words in (
        ["run", str(graph), "--fused", "--duration", "0.12", "--record", file, "-q"],
        ["info", file],
        ["echo", file, "contact"],
        ["picture", file, "--out", "Bilder ü"],
        ["replay", file, "--check"],
        ["compare", file, "--set", "tissue.stiffness=4e3", "--out", "Vergleich.png"],
        ["export", file, "--to", "csv"],
        ["rates", str(graph), "--error", "5 %", "--duration", "0.1", "--out", "Raten.yaml"],
        ["plan", str(graph)],
        ["doctor", "--json"],
    ):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, (words, done.output, done.exception)
    assert Path("Vergleich.png").stat().st_size > 10_000


def touched(graph, folder):
    """`palpate touch`: the page moves the finger of a run on the real clock."""
    from test_page import PRESSED, Server, until

    server = Server(folder)
    with server.open() as client:
        press = {"point": [1, PRESSED, 1]}
        head = until(client, lambda head: head["kind"] == "frame" and head["load"] > 0.3, press)[0]
        assert head["force"][2] > 0.1 and head["sample"] == 1
    server.close()


PARTS = {part.__name__: part for part in (runs, many, shown, apart, computed, commands, touched)}

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    place = Path("Über der Niere").absolute()
    place.mkdir()
    for part in sys.argv[2:]:
        (place / part).mkdir()
        PARTS[part](Path(sys.argv[1]), place / part)
