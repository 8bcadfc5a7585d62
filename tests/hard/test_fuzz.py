"""Hostile input: what is read from outside is cut, flipped, swapped and blown up. Nothing but a told error comes out,
in time, and without memory taken by a number that the input claims."""

from __future__ import annotations

import os
import pickle
import random
import shutil
import signal
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.drivers.falcon import frames
from palpate.drivers.haply import inverse3
from palpate.drivers.hid import descriptor
from palpate.fit.sessions import read_sessions
from palpate.launch.loading.files import GRAPHS
from palpate.launch.loading.launchfile import LaunchFile
from palpate.launch.recording.reader import Recording
from palpate.launch.recording.recover import recover
from palpate.messages import Contact, DeviceState, Load, MessageError, Surface, pack, unpack
from palpate.nodes.base.mesh_file import read_mesh
from palpate.nodes.contact.probabilistic import read_law
from palpate.nodes.deformation.basis_store import SHIPPED
from palpate.nodes.device.motion import read_motion
from palpate.physics.bodies.condensed_body import Basis
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.errors import PalpateError
from palpate.physics.fingertip.surfaces import Fingertip

EXAMPLES = int(os.environ.get("PALPATE_EXAMPLES", 40))
GOLDEN = Path(__file__).parents[1] / "golden" / "plane.mcap"
LONGEST, MOST = 20, 600e6
"""[s], [byte] that one input may take; the largest shipped basis takes 30 MB."""
NUMBERS = (b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x00\x00\x00\x00", b"\xff" * 8, b"1e308", b"-1", b"nan", b"")


def hostile(rng: random.Random, data: bytes) -> bytes:
    """A neighbour of these bytes."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at = rng.randrange(len(out)) if out else 0
        match rng.randrange(7):
            case 0 if out:
                out[at] ^= 1 << rng.randrange(8)
            case 1:
                del out[at:]
            case 2:
                out[at : at + 4] = rng.choice(NUMBERS)
            case 3:
                del out[at : at + rng.randrange(1, 64)]
            case 4:
                out[at:at] = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 32)))
            case 5:
                other = rng.randrange(len(out)) if out else 0
                out[at : at + 16] = out[other : other + 16]
            case 6:
                out[at:at] = out[at : at + 200] * rng.randrange(1, 4)
    return bytes(out)


class TooLong(Exception):
    """It hung."""


def attempt(
    read: Callable[[], Any], allowed: tuple[type[Exception], ...] = (PalpateError,), measured: bool = True
) -> None:
    """Read; an error that users are told is fine, and nothing else. `measured`: its memory too, which is slow."""

    def late(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST)
    if measured:
        tracemalloc.start()
    try:
        read()
    except allowed:
        pass
    except BaseException as error:
        what = f"{type(error).__name__}: {str(error)[:200]}, {_where(error)}"
        raise AssertionError(what) from None  # a traceback a thousand frames deep helps nobody
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        _, peak = tracemalloc.get_traced_memory() if measured else (0, 0)
        tracemalloc.stop()
    assert peak < MOST


def _where(error: BaseException) -> str:
    """The last line of ours that it came through."""
    frames, step = "", error.__traceback__
    while step is not None:
        file = step.tb_frame.f_code.co_filename
        frames = f"{file}:{step.tb_frame.f_lineno}" if "site-packages" not in file and "/lib/" not in file else frames
        step = step.tb_next
    return frames


@pytest.mark.parametrize("kind", [Contact, DeviceState, Load, Surface])
def test_messages(kind):
    examples = {
        Contact: Contact((0, 0, 0), (0, 0, 1), 1.0, 1e-3, 1e-3, 0.0, 0.0),
        DeviceState: DeviceState(position=(0.0, 0.0, 0.0)),
        Load: Load(nodes=np.arange(5), forces=np.ones((5, 3)), foot=(0, 0, 0), normal=(0, 0, 1)),
        Surface: Surface.example(True),
    }
    rng, data = random.Random(1), pack(examples[kind])
    for _ in range(20 * EXAMPLES):
        attempt(lambda: unpack(hostile(rng, data), kind), (MessageError, msgspec.DecodeError))


@pytest.mark.parametrize("name", ["kidney", "softness", "falcon"])
def test_graphs(tmp_path, name):
    rng, data = random.Random(2), (GRAPHS / f"{name}.yaml").read_bytes()
    for k in range(EXAMPLES):
        path = tmp_path / f"{k}.yaml"
        path.write_bytes(hostile(rng, data))
        attempt(lambda path=path: LaunchFile(graph=path).load(), measured=False)


def test_graphs_run_no_code_and_swell_to_no_size(tmp_path):
    mark = tmp_path / "mark"
    laughs = "\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9) if k else 1}]" for k in range(12))
    for text in (
        f"nodes: !!python/object/apply:os.system ['touch {mark}']",
        laughs,
        "[" * 50_000,
        "a: " + "{a: " * 5000,
    ):
        path = tmp_path / "bad.yaml"
        path.write_text(text)
        attempt(lambda path=path: LaunchFile(graph=path).load(), measured=False)
    assert not mark.exists()


def test_recordings(tmp_path):
    rng, data = random.Random(3), GOLDEN.read_bytes()

    def through(path: Path) -> None:
        recording = Recording(path)
        for stream in recording.streams:
            for _ in recording.payloads(stream):
                pass

    for k in range(EXAMPLES // 2):
        path = tmp_path / f"{k}.mcap"
        path.write_bytes(hostile(rng, data))
        attempt(lambda path=path: through(path))
        attempt(lambda path=path, k=k: recover(path, tmp_path / f"out{k}.mcap"))


def mesh_texts(folder: Path) -> list[tuple[str, bytes]]:
    triangle = np.zeros(4, dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.05
    triangle["v"] = corners[[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]]
    stl = bytes(80) + np.uint32(4).tobytes() + triangle.tobytes()
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    ply = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        + "".join(f"{x} {y} {z}\n" for x, y, z in corners)
        + "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    )
    return [("stl", stl), ("obj", obj.encode()), ("ply", ply.encode())]


def test_meshes(tmp_path):
    for kind, data in mesh_texts(tmp_path):
        rng, path = random.Random(4), tmp_path / f"m.{kind}"
        path.write_bytes(data)
        assert len(read_mesh(str(path), 1.0).vertices) == 4
        for _ in range(EXAMPLES):
            path.write_bytes(hostile(rng, data))
            attempt(lambda path=path: read_mesh(str(path), 1.0))


@pytest.mark.parametrize(
    ("load", "file"),
    [
        (Basis.load, SHIPPED / "plane-dents.npz"),
        (SampledBasis.load, SHIPPED / "fingertip-sampled.npz"),
        (Fingertip.load, SHIPPED.parents[1] / "tables" / "fingertip.npz"),
    ],
)
def test_bases(tmp_path, load, file):
    rng, data = random.Random(5), file.read_bytes()
    head = data[:400]
    for k in range(EXAMPLES // 4):
        path = tmp_path / f"{k}.npz"
        path.write_bytes(hostile(rng, head) + data[400:] if k % 2 else hostile(rng, data))
        attempt(lambda path=path: load(path))


def test_bases_run_no_code(tmp_path):
    class Touch:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "mark",))

    np.savez(tmp_path / "bad.npz", vertices=np.array([Touch()], dtype=object), about=np.array("{}"))
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps(Touch()))
    for name in ("bad.npz", "pickle.npz"):
        for load in (Basis.load, SampledBasis.load, Fingertip.load):
            attempt(lambda load=load, name=name: load(tmp_path / name))
    assert not (tmp_path / "mark").exists()


SESSIONS = "subject,session,depth [mm],force [N]\n" + "".join(
    f"a,{s},{d / 2},{0.1 * d * (1 + 0.01 * s)}\n" for s in range(3) for d in range(6)
)
MOTION = "t,x,y,z\n0,0,0,0.1\n0.1,0,0,0.09\n0.2,0,0,0.1\n"
LAW = "subjects:\n  a: {mean: [1.0, 2.0], deviation: [0.1, 0.2], freedom: 10}\n"


@pytest.mark.parametrize(
    ("text", "read"),
    [
        (SESSIONS, read_sessions),
        (MOTION, lambda path: read_motion(str(path))),
        (LAW, lambda path: read_law(path, "a")),
    ],
    ids=["sessions", "motion", "law"],
)
def test_texts(tmp_path, text, read):
    rng, path = random.Random(6), tmp_path / "in.csv"
    for _ in range(5 * EXAMPLES):
        path.write_bytes(hostile(rng, text.encode()))
        attempt(lambda: read(path))


def test_image_stacks(tmp_path):
    pytest.importorskip("nibabel")
    pytest.importorskip("pydicom")
    from palpate.scan import phantom, read

    stack = phantom.scan()
    nifti = Path(phantom.write_nifti(stack, tmp_path / "v.nii"))
    dicom = Path(phantom.write_dicom(stack, tmp_path / "d"))
    pictures = Path(phantom.write_images(stack, tmp_path / "p"))
    rng = random.Random(7)
    head = nifti.read_bytes()
    for k in range(EXAMPLES // 4):
        nifti.write_bytes(hostile(rng, head[:352]) + head[352:] if k % 2 else hostile(rng, head))
        attempt(lambda: read(nifti))
        for folder, spacing in ((dicom, None), (pictures, (1.2e-3, 0.23e-3, 0.23e-3))):
            files = sorted(f for f in folder.iterdir() if f.is_file())
            one = rng.choice(files)
            whole = one.read_bytes()
            one.write_bytes(hostile(rng, whole[:600]) + whole[600:])
            attempt(lambda folder=folder, spacing=spacing: read(folder, spacing))
            one.write_bytes(whole)
    shutil.rmtree(dicom)


def test_device_frames():
    rng = random.Random(8)
    whole = frames.report((1, -200, 3000), 5, (True, True, True)) * 3
    place = '{"inverse3": [{"state": {"cursor_position": {"x": 0.1, "y": 0, "z": 1e-3}}}], '
    told = place + '"versegrip": [{"state": {"buttons": {"a": true}}}]}'
    report = bytes.fromhex("05010904a101150026ff0375100930093181020509190129081500250175019508810275019508c0")
    reader = frames.Reader()
    for _ in range(20 * EXAMPLES):
        for frame in reader.feed(hostile(rng, whole)):
            assert all(-32768 <= n <= 32767 for n in frames.read(frame).counts)
        message = inverse3.state(hostile(rng, told.encode()).decode("latin-1"))
        inverse3.buttons(message)
        for device in message.get("inverse3") or []:
            place = inverse3.position(device)
            assert place is None or np.isfinite(place).all()
        for field in descriptor.fields(hostile(rng, report)):
            field.value(b"\x01\x02")
            field.value(b"")
