"""Damaged files: only a palpate error comes out, with the file's name; no memory by a length that is only claimed.

Files are cut off, their bits flipped, bytes overwritten by large numbers, a part left out or repeated.
"""

import json
import pickle
import random
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk

from palpate.drivers.errors import DeviceError
from palpate.drivers.falcon import frames
from palpate.drivers.haply import inverse3
from palpate.drivers.hid import raw
from palpate.drivers.sensors import netft
from palpate.launch.load.files import GRAPHS, SCENES
from palpate.launch.load.launchfile import find
from palpate.messages import Contact, DeviceState, Load, MessageError, Surface, pack, unpack
from palpate.models.fit.sessions import read_sessions
from palpate.nodes.base.mesh_file import read_mesh
from palpate.nodes.contact.probabilistic import read_law
from palpate.nodes.deformation import basis_store
from palpate.nodes.device.motion import read_motion
from palpate.nodes.tactile.flow import TABLE, Flow
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.errors import PalpateError
from palpate.physics.fingertip.surfaces import FingertipSurfaces
from palpate.records.contents import contents
from palpate.records.fill import recover
from palpate.records.format.mcap_file import MAGIC, Broken, read_records
from palpate.records.reader import Recording

FEW, MANY = 12, 4000
ROOM = 300_000_000  # [bytes] at most while a file of some hundred kilobytes is read; shipped bases take a third of it


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The bytes with one to three damages."""
    spoilt = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        if not spoilt:
            break
        # Half of them near the ends, where formats say how long their parts are.
        at = rng.randrange(len(spoilt)) if rng.random() < 0.5 else rng.choice((1, -1)) * rng.randrange(1, 200)
        at %= len(spoilt)
        match rng.randrange(6):
            case 0:
                del spoilt[at:]
            case 1:
                spoilt[at] ^= 1 << rng.randrange(8)
            case 2:
                size = rng.choice((1, 2, 4, 8))
                spoilt[at : at + size] = rng.choice((b"\xff", b"\x7f", b"\x00")) * size
            case 3:
                del spoilt[at : at + rng.randrange(1, 100)]
            case 4:
                spoilt[at:at] = spoilt[at : at + rng.randrange(1, 100)]
            case 5:
                spoilt[at : at + 8] = rng.randbytes(8)
    return bytes(spoilt)


def survives(read: Callable[[Path], object], path: Path, data: bytes, seeds: range, named: str = "") -> int:
    """Read damaged copies; how many were refused. Anything but a palpate error fails, and so does much memory."""
    refused = 0
    tracemalloc.start()
    try:
        for seed in seeds:
            path.write_bytes(damaged(data, random.Random(seed)))
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            try:
                read(path)
            except PalpateError as error:
                refused += 1
                assert any(name in str(error) for name in (path.stem, path.parent.name, named or path.stem)), error
            except Exception as error:
                raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}") from error
            most = tracemalloc.get_traced_memory()[1] - before
            assert most < ROOM, f"seed {seed}: {most} bytes"
    finally:
        tracemalloc.stop()
    return refused


LONG = (pytest.mark.long, pytest.mark.timeout(3600))
COUNTS = [pytest.param(range(FEW), id="few"), pytest.param(range(FEW, MANY), id="many", marks=LONG)]


@pytest.fixture
def touch(short_kidney) -> bytes:
    return short_kidney.read_bytes()


@pytest.mark.parametrize("seeds", COUNTS)
def test_a_damaged_recording_is_an_error_and_its_complete_part_is_recovered(tmp_path, touch, seeds):
    path = tmp_path / "touch.mcap"
    path.write_bytes(touch)
    whole = {(stream, tick): payload for stream, tick, _, payload in Recording(path).raw()}

    def read(damaged_path: Path) -> None:
        recording = Recording(damaged_path)
        printed = contents(recording)
        if recording.complete:
            assert damaged_path.read_bytes() == touch or sum(s["count"] for s in printed["streams"]) == len(whole)
        for stream, tick, _, payload in recording.raw():
            assert whole[stream, tick] == payload
        target, counts = recover(damaged_path, tmp_path / "again.mcap")
        again = Recording(target)
        assert again.complete and sum(1 for _ in again.raw()) == sum(counts.values())
        target.unlink()

    assert survives(read, path, touch, seeds) < len(seeds)


def test_a_chunk_that_claims_to_be_huge_reserves_no_memory(tmp_path):
    """The library reserves what the packed bytes say: here 4 GB for a few hundred of them."""
    size = 1 << 17
    packed = bytearray(zstandard.ZstdCompressor().compress(bytes(size)))
    at = packed.index(size.to_bytes(4, "little"))
    packed[at : at + 4] = b"\xff" * 4
    for claimed in (size, (1 << 32) - 1):
        builder = RecordBuilder()
        Chunk("zstd", bytes(packed), 0, 0, 0, claimed).write(builder)
        path = tmp_path / "huge.mcap"
        path.write_bytes(MAGIC + builder.end())
        tracemalloc.start()
        with pytest.raises(Broken, match="cannot be decompressed"):
            list(read_records(path))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 10_000_000


ARCHIVES = {
    "condensed": (basis_store.SHIPPED / "plane-condensed.npz", Basis.load),
    "sampled": (basis_store.SHIPPED / "fingertip-sampled.npz", SampledBasis.load),
    "about": (basis_store.SHIPPED / "fingertip-sampled.npz", basis_store.about),
    "table": (TABLE, lambda path: started(Flow(table=str(path)))),
}


def started(node: Flow) -> None:
    node.start()


@pytest.mark.parametrize("seeds", COUNTS)
@pytest.mark.parametrize("name", ARCHIVES)
def test_a_damaged_archive_of_arrays_is_an_error(tmp_path, name, seeds):
    source, load = ARCHIVES[name]
    refused = survives(load, tmp_path / "spoilt.npz", source.read_bytes(), seeds)
    assert refused or name == "about"


@pytest.mark.parametrize("seeds", COUNTS)
@pytest.mark.parametrize("missing", ["a name", "a row", "an axis", "a number"])
def test_an_archive_of_other_arrays_is_an_error(tmp_path, missing, seeds):
    """Whole, but of another kind: each array of each archive left out, cut, flattened, or full of what is no number."""
    for name, (source, load) in ARCHIVES.items():
        if name == "about" or (name == "condensed" and len(seeds) <= FEW):
            continue
        with np.load(source) as archive:
            arrays = dict(archive)
        names = sorted(arrays)
        for key in random.Random(seeds[0]).sample(names, min(2 if len(seeds) <= FEW else len(names), len(names))):
            other = dict(arrays)
            match missing:
                case "a name":
                    del other[key]
                case "a row":
                    other[key] = arrays[key][1:] if arrays[key].ndim else np.zeros(0)
                case "an axis":
                    other[key] = arrays[key].reshape(-1)[:7]
                case "a number":
                    other[key] = np.full(arrays[key].shape, "word")
            np.savez(tmp_path / "other.npz", **other)
            try:
                load(tmp_path / "other.npz")
            except PalpateError as error:
                assert "other.npz" in str(error)


def test_a_damaged_fingertip_is_an_error(tmp_path):
    from palpate.physics.fingertip.surfaces import FIELDS

    grid = np.linspace(-1e-3, 1e-3, 64).reshape(4, 4, 4)
    arrays = dict(zip(FIELDS, (np.zeros(3), np.full(3, 1e-3), grid, grid, grid), strict=True))
    np.savez_compressed(tmp_path / "whole.npz", **arrays)
    data = (tmp_path / "whole.npz").read_bytes()
    assert survives(FingertipSurfaces.load, tmp_path / "spoilt.npz", data, range(200))


def cube(kind: str) -> bytes:
    trimesh = pytest.importorskip("trimesh")
    data = trimesh.creation.box((20.0, 20.0, 20.0)).export(file_type=kind.removesuffix(" text"))
    return data if isinstance(data, bytes) else data.encode()


@pytest.mark.parametrize("seeds", COUNTS)
@pytest.mark.parametrize("kind", ["stl", "ply", "obj"])
def test_a_damaged_mesh_is_an_error(tmp_path, kind, seeds):
    survives(lambda path: read_mesh(str(path), 1e-3), tmp_path / f"spoilt.{kind}", cube(kind), seeds)


@pytest.mark.parametrize("seeds", COUNTS)
@pytest.mark.parametrize("kind", ["nii", "dcm"])
def test_damaged_images_are_errors(tmp_path, kind, seeds):
    pytest.importorskip("pydicom")
    pytest.importorskip("nibabel")
    pytest.importorskip("skimage")
    import phantom_finger as phantom

    from palpate.models.scan import read

    small = phantom.scan(slices=4, pixels=19, spacing=(1.2e-3, 1.4e-3, 1.4e-3))
    folder = tmp_path / "spoilt"
    if kind == "nii":
        folder.mkdir()
        given = path = phantom.write_nifti(small, folder / "spoilt.nii")
    else:
        path, given = sorted(phantom.write_dicom(small, folder).iterdir())[1], folder
    survives(lambda _: read(given), path, path.read_bytes(), seeds)
    shutil.rmtree(folder)


@pytest.mark.parametrize("seeds", COUNTS)
def test_damaged_sessions_are_errors(tmp_path, seeds):
    rows = [
        f"{who},{k},{0.1 * d:.1f},{0.01 * d * d + 0.001 * k:.4f}" for who in "ab" for k in (1, 2) for d in range(20)
    ]
    data = "\n".join(["subject,session,depth [mm],force [N]", *rows]).encode()
    assert survives(read_sessions, tmp_path / "spoilt.csv", data, seeds)


LAUNCH = b"""# One run.
graph: kidney
clock: simulated
duration: 6.3 s
record: kidney.mcap
"""


def find_and_plan(path: Path) -> None:
    find(str(path)).plan()


@pytest.mark.parametrize("seeds", COUNTS)
@pytest.mark.parametrize("kind", ["graph", "launch", "scene"])
def test_a_damaged_graph_launch_file_or_scene_is_an_error(tmp_path, kind, seeds):
    if kind == "scene":
        source = SCENES / "kidney.yaml"
        read: Callable[[Path], object] = lambda path: find("kidney").but(scene=path).plan()  # noqa: E731
    else:
        source, read = GRAPHS / "kidney.yaml", find_and_plan
    text = LAUNCH if kind == "launch" else source.read_bytes()
    survives(read, tmp_path / "spoilt.yaml", text, seeds, named="kidney.yaml")


GROWS = "a: &a [" + "x," * 50 + "]\nb: [" + "*a," * 9000 + "]"
RUNS = "!!python/object/apply:os.system [touch was-run]"


@pytest.mark.parametrize("text", ["&a [*a, *a]", GROWS, "[" * 5000, RUNS, "a: " + "9" * 5000, "\0", "? {a: b}\n: c"])
def test_yaml_that_expands_nests_or_executes_is_an_error(tmp_path, text, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "g.yaml").write_text(text)
    with pytest.raises(PalpateError):
        find_and_plan(tmp_path / "g.yaml")
    assert not (tmp_path / "was-run").exists()


def test_a_file_with_too_many_keys_is_an_error(tmp_path):
    """100 000 keys took 14 s and 431 MB."""
    (tmp_path / "g.yaml").write_text("".join(f"k{i}: 1\n" for i in range(25_000)))
    with pytest.raises(PalpateError, match="more than 20000 entries"):
        find_and_plan(tmp_path / "g.yaml")


TRUE = frames.report((1, 2, 3), 0, (True, True, True))


@settings(max_examples=60)
@given(seed=st.integers(0, 10**9), rubbish=st.lists(st.binary(max_size=60), max_size=8))
def test_device_frames_among_invalid_bytes_are_read_and_the_rest_is_discarded(seed, rubbish):
    reader, rng = frames.FalconFrameReader(), random.Random(seed)
    for piece in rubbish:
        for frame in reader.feed(piece + damaged(TRUE, rng)):
            frames.read(frame)
    for _ in range(20):
        reader.feed(rng.randbytes(500))
    assert len(reader._rest) < 2000


@settings(max_examples=150)
@given(data=st.binary(max_size=200))
def test_reports_of_hid_devices_are_read_or_refused(data):
    body = data.ljust(raw.LENGTH, b"\0")[: raw.LENGTH - 2]
    raw.unpack(data)
    raw.unpack(body + raw.crc16_x25(body).to_bytes(2, "little"))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4) | st.just(10**400),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["state", "cursor_position", "x", "y", "z", "buttons", "a", *inverse3.GRIPS]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=6,
)


@settings(max_examples=60)
@given(message=JSON)
def test_messages_of_the_service_of_a_device_are_read_or_ignored(message):
    printed = inverse3.state(json.dumps(message))
    inverse3.position(printed)
    inverse3.buttons(printed)


def test_endless_nesting_from_the_service_of_a_device_is_ignored():
    assert inverse3.state("[" * 100_000) == {}
    assert inverse3.state('{"a": ' + "9" * 5000 + "}") == {}


@settings(max_examples=100)
@given(force=st.text("0123456789.-+einfa", max_size=8), torque=st.text("0123456789.-+einfa", max_size=8))
def test_the_page_of_a_sensor_gives_a_finite_scale_or_an_error(force, torque):
    page = f"<p><cfgcpf>{force}</cfgcpf><cfgcpt>{torque}</cfgcpt></p>".encode()
    try:
        scale = netft.scale(page)
    except DeviceError:
        return
    assert all(np.isfinite(scale)) and scale.force > 0 and scale.torque > 0


MESSAGES = {
    "contact": Contact((0, 0, 0), (0, 0, 1), 1.0, 1e-3, 1e-3, 0.0, 0.0),
    "state": DeviceState(position=(0.0, 0.0, 0.0)),
    "load": Load(nodes=np.arange(5), forces=np.ones((5, 3)), foot=(0, 0, 0), normal=(0, 0, 1)),
    "surface": Surface.example(True),
}


@pytest.mark.parametrize("seeds", COUNTS)
@pytest.mark.parametrize("kind", MESSAGES)
def test_a_damaged_message_is_an_error_or_valid(kind, seeds):
    data, refused = pack(MESSAGES[kind]), 0
    for seed in range(20 * seeds.start, 20 * seeds.stop):
        try:
            unpack(damaged(data, random.Random(seed)), type(MESSAGES[kind]))
        except MessageError:
            refused += 1
    assert refused


MOTION = b"t,x,y,z\n0,0,0,0.1\n0.1,0,0,0.09\n0.2,0,0,0.1\n"
LAW = b"subjects:\n  a: {mean: [1.0, 2.0], deviation: [0.1, 0.2], freedom: 10}\n"


@pytest.mark.parametrize("seeds", COUNTS)
def test_damaged_motions_and_laws_are_errors(tmp_path, seeds):
    assert survives(lambda path: read_motion(str(path)), tmp_path / "spoilt.csv", MOTION, seeds)
    assert survives(lambda path: read_law(path, "a"), tmp_path / "spoilt.yaml", LAW, seeds)


def test_archives_execute_no_code(tmp_path):
    class Touch:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "mark",))

    np.savez(tmp_path / "bad.npz", vertices=np.array([Touch()], dtype=object), about=np.array("{}"))
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps(Touch()))
    for name in ("bad.npz", "pickle.npz"):
        for load in (Basis.load, SampledBasis.load, FingertipSurfaces.load):
            with pytest.raises(PalpateError):
                load(tmp_path / name)
    assert not (tmp_path / "mark").exists()


def test_a_basis_of_many_vertices_and_few_numbers_reserves_no_matrix(tmp_path):
    """100 000 vertices would need a matrix of 360 GB; the reader first counts the numbers in the file."""
    path, many, none = tmp_path / "wide.npz", np.zeros((100_000, 3)), np.zeros((6, 2), np.uint8)
    np.savez_compressed(path, vertices=many, triangles=np.zeros((1, 3), int), lower=none, step=1.0)
    with pytest.raises(PalpateError, match="compliances for 100000 vertices"):
        Basis.load(path)
    with np.load(basis_store.SHIPPED / "fingertip-sampled.npz") as shipped:
        arrays = dict(shipped)
    np.savez_compressed(path, **{**arrays, "vertices": many})
    with pytest.raises(PalpateError, match="100000 vertices"):
        SampledBasis.load(path)
