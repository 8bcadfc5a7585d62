"""Every reader of files: what it opens, what its memory and time depend on, and which numbers it takes as indices.

Readers are found by their place: each module that opens a file to read is in `READERS` with what it reads, or in
`NO_READERS` with the reason why a file of another user does not reach it.
"""

import ast
import gzip
import json
import os
import resource
import signal
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from sources import nodes

from palpate.physics.errors import PalpateError

ROOT = Path(__file__).parents[2]
OPENING = {
    "open", "read_bytes", "read_text", "fromfile", "memmap", "loadtxt", "genfromtxt", "ZipFile", "ParquetFile",
    "open_group", "dcmread", "load_data", "File", "read_parquet", "open_zarr",
}  # fmt: skip
LIBRARIES = {
    "np.load", "numpy.load", "nibabel.load", "meshio.read", "trimesh.load", "pickle.load", "pyarrow.parquet.read_table",
}  # fmt: skip
LAST = {name.rpartition(".")[2] for name in LIBRARIES}
WRITING = {"w", "wb", "ab", "a", "x", "xb"}

NO_READERS = {
    "launch/load/launchfile.py": "the first line of a file that `values/source.py` has read",
    "launch/run/busy.py": "/proc and the control group of this process",
    "launch/run/interrupts.py": "/dev/null",
    "launch/run/work/activity.py": "/proc",
    "launch/run/work/forked.py": "/proc",
    "launch/run/work/offered.py": "a recording that a logger replaces: its first bytes",
    "launch/run/work/process.py": "/dev/null",
    "launch/run/wire/addresses.py": "locks in the private folder of the user",
    "nodes/deformation/basis_store.py": "the index of the shipped bases",
    "nodes/device/mailbox.py": "a file in the private folder of a page",
    "src/palpate/studies/kept.py": "results of a search, of the user who resumes it",
    "src/palpate/cli/commands/graphs/new.py": "a shipped graph, as a template",
    "src/palpate/cli/machine/bytecode.py": "the bytecode of installed modules",
    "src/palpate/cli/terminal/browser.py": "an address",
    "src/palpate/compiler/arithmetic.py": "/proc, and the version of numpy",
    "src/palpate/compiler/content/origin.py": "the sources of palpate",
    "src/palpate/compiler/kernel_cache.py": "the sources of palpate",
    "src/palpate/compiler/kernel_files.py": "a cache; `trust.py` checks its owner",
    "src/palpate/compiler/trust.py": "a cache; it checks the owner",
    "src/palpate/drivers/discover.py": "/sys",
    "src/palpate/drivers/exchange.py": "a device",
    "src/palpate/engine/provenance.py": "/proc",
    "src/palpate/ensemble.py": "the store that it has written",
    "src/palpate/models/build/basis.py": "the index of a folder in which it writes a basis",
    "src/palpate/models/fe/reduce/snapshots.py": "a cache; `trust.py` checks its owner",
    "src/palpate/models/files/hdf5.py": "called by readers",
    "src/palpate/physics/claims.py": "called by readers",
    "src/palpate/physics/segmentation/stored.py": "a store; `trust.py` checks its owner",
    "src/palpate/physics/scratch.py": "a lock in a temporary folder of the user",
    "src/palpate/physics/readable.py": "the bytes of any file, for a hash",
    "src/palpate/records/format/attached.py": "`mcap_file.py` reads the file; the bytes of others are only copied",
    "src/palpate/records/reader.py": "a recording that `records/stored.py` has opened",
    "src/palpate/records/format/claim.py": "a regular file, to be overwritten",
    "src/palpate/records/format/mcap_append.py": "a recording that this process has written",
    "src/palpate/studies/accuracy/cells.py": "a cache; `trust.py` checks its owner",
    "src/palpate/studies/accuracy/output/stored.py": "the shipped results",
    "src/palpate/studies/accuracy/sites.py": "the shipped references",
    "src/palpate/studies/meeting/stored.py": "the shipped references",
    "src/palpate/studies/fits/tables.py": "tables that this search has kept",
    "src/palpate/web/folder.py": "the files of the shipped page",
    "src/palpate/web/recording.py": "a recording that it has written",
    "src/palpate/studies/peers/calculix.py": "what a solver has written in a temporary folder",
    "src/palpate/studies/psychophysics/opening.py": "the experiment's file, which `values/source.py` has read",
    "src/palpate/views/page/reel.py": "a recording that `records/stored.py` has opened",
    "src/palpate/views/page/server.py": "the shipped pages, and /proc",
    "src/palpate/views/run.py": "an address",
    "src/palpate/views/surface/off_screen.py": "what the process that draws has written",
    "src/palpate/views/surface/render.py": "what the process that draws is given",
}


def opens(path: Path) -> bool:
    """Whether a module has a call that opens a file, other than to write."""
    for node in nodes(path):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        if name not in OPENING and (name not in LAST or ast.unparse(node.func) not in LIBRARIES):
            continue
        modes = {
            each.value for each in [*node.args, *(k.value for k in node.keywords)] if isinstance(each, ast.Constant)
        }
        if not modes & WRITING:
            return True
    return False


def modules() -> set[str]:
    found = set()
    for top in ("messages", "nodes", "graphs", "launch", "src/palpate"):
        for path in sorted((ROOT / top).rglob("*.py")):
            place = path.relative_to(ROOT)
            if not any((ROOT / part).is_symlink() for part in (place, *place.parents)) and opens(path):
                found.add(str(place))
    return found


# -- the readers -----------------------------------------------------------------------------------------------------


def organ(path):
    from palpate.nodes.base.surface import surface_mesh

    return surface_mesh(str(path), 0)


def region(path):
    from palpate.physics.segmentation.region import read_region

    return read_region(str(path))


def tetrahedra(path):
    from palpate.models.fe.element.files import read_mesh

    return read_mesh(path)


def texture(path):
    from palpate.nodes.base.texture_file import read_texture

    return read_texture(path)


def relief(path):
    from palpate.physics.texture.surface import profile

    return profile(path, 0.0, 1e-3)


def law(path):
    from palpate.nodes.contact.probabilistic import read_law

    return read_law(path, "")


def yaml_file(path):
    from palpate.launch.load.values.source import read

    return read(path)


def named(path):
    from palpate.launch.load.dependencies import content

    return content(str(path))


def key(path):
    from palpate.launch.run.wire import keys

    keys.folder = lambda: path.parent  # in a child
    return keys.load(path.stem)


def firmware(path):
    from palpate.drivers.falcon.firmware import image

    return image(str(path))


def press_file(path):
    from palpate.models.fit.press import rows_before

    return rows_before(path, "a", "1")


def afm(path):
    from palpate.models.fit.tissue.afm import read_afm

    return read_afm(path)


def scan(path):
    from palpate.models.scan.read import read

    return read(path)


def segmentation(path):
    from palpate.physics.segmentation.image import choose_label
    from palpate.physics.segmentation.read import read_labels
    from palpate.physics.segmentation.surface import label_surface

    image = read_labels(path)
    return label_surface(image, choose_label(image, None))


def afferents(path):
    from palpate.physics.afferents.population import read

    return read(path, (1e-3, 2e-3), 0)


def archive(path):
    from palpate.physics.archive import read_arrays

    return read_arrays(path)


def basis(path):
    from palpate.physics.bodies.condensed_basis import Basis

    return Basis.load(path)


def sampled(path):
    from palpate.physics.bodies.sampled_body import SampledBasis

    return SampledBasis.load(path)


def fingertip(path):
    from palpate.physics.fingertip.surfaces import FingertipSurfaces

    return FingertipSurfaces.load(path)


def sessions(path):
    from palpate.models.fit.sessions import read_sessions

    return read_sessions(path)


def motion(path):
    from palpate.nodes.device.motion import read_motion

    return read_motion(str(path))


def pressed(path):
    from palpate.models.fe.study.press_record import PressRun

    return PressRun(path.parent).settings()


def recording(path):
    from palpate.records.reader import Recording

    return list(Recording(path).raw())


def study(path):
    from palpate.studies.sweeps.store import Store

    return Store(path.parent, write=False)


def answers(path):
    from palpate.studies.psychophysics.store import read_content

    return read_content(path)


def participants(path):
    from palpate.records.export.nwb import participant

    return participant(path.parent / "sub-01" / "a.mcap")


@dataclass(frozen=True)
class Reader:
    """A way in for a file.

    read      reads the file at a path
    modules   that open it, from the repository's root
    names     file names that select it
    refuses   the exceptions of a file that cannot be read, caught and reported by its callers
    quiet     whether a file that is not regular counts as none
    """

    read: Callable[[Path], object]
    modules: tuple[str, ...]
    names: tuple[str, ...]
    refuses: tuple[type[Exception], ...] = (PalpateError,)
    quiet: bool = False


FORMATS = "nodes/base/mesh_formats/__init__.py"
PHYSICS = "src/palpate/physics"
OWN = (PalpateError, OSError, ValueError)
READERS = {
    "organ": Reader(organ, (FORMATS, "nodes/base/mesh_file.py", "nodes/base/surface.py"), ("a.stl", "a.ply", "a.obj")),
    "tetrahedra": Reader(tetrahedra, ("src/palpate/models/files/apart.py",), ("a.msh", "a.vtk", "a.vtu", "a.inp",
                                                                               "a.xdmf", "a.med")),
    "texture": Reader(texture, ("nodes/base/texture_file.py",), ("a.json",), OWN),
    "relief": Reader(relief, (f"{PHYSICS}/texture/surface.py",), ("a.csv",), OWN),
    "law": Reader(law, ("nodes/contact/probabilistic.py",), ("a.yaml",)),
    "graph": Reader(yaml_file, ("launch/load/values/source.py",), ("a.yaml",)),
    "named by a setting": Reader(named, ("launch/load/dependencies.py",), ("a.bin",), quiet=True),
    "key": Reader(key, ("launch/run/wire/keys.py",), ("a.json",)),
    "firmware": Reader(firmware, ("src/palpate/drivers/falcon/firmware.py",), ("a.bin",)),
    "recorded presses": Reader(press_file, ("src/palpate/models/fit/press.py",), ("a.csv",), OWN),
    "AFM": Reader(afm, ("src/palpate/models/fit/tissue/afm.py",), ("a.h5", "a.jpk-force", "a.ibw", "a.zip")),
    "scan": Reader(scan, ("src/palpate/models/scan/read.py",), ("a.nii", "a.nii.gz")),
    "segmentation": Reader(
        segmentation, tuple(f"{PHYSICS}/segmentation/{name}.py" for name in ("nifti", "nrrd", "metaimage", "dicom",
                                                                              "voxels")),
        ("a.nii.gz", "a.nrrd", "a.mha", "a.dcm", "a.nii"),
    ),
    "afferents": Reader(afferents, (f"{PHYSICS}/afferents/population.py",), ("a.csv",), OWN),
    "archive": Reader(archive, (f"{PHYSICS}/archive.py",), ("a.npz",)),
    "basis": Reader(basis, (f"{PHYSICS}/archive.py", f"{PHYSICS}/bodies/condensed_basis.py"), ("a.npz",)),
    "sampled basis": Reader(sampled, (f"{PHYSICS}/archive.py", f"{PHYSICS}/bodies/sampled_body.py"), ("a.npz",)),
    "fingertip": Reader(fingertip, (f"{PHYSICS}/archive.py",), ("a.npz",)),
    "region": Reader(region, (f"{PHYSICS}/archive.py",), ("a.npz",)),
    "sessions": Reader(sessions, (f"{PHYSICS}/table_text.py", f"{PHYSICS}/table_books.py"), ("a.csv", "a.xlsx",
                                                                                             "a.mat")),
    "motion": Reader(motion, (f"{PHYSICS}/table_text.py",), ("a.csv",)),
    "pressing": Reader(pressed, ("src/palpate/models/fe/study/press_record.py",), ("run.json",)),
    "recording": Reader(recording, ("src/palpate/records/stored.py", "src/palpate/records/format/mcap_file.py",
                                    "src/palpate/records/fill.py"), ("a.mcap",)),
    "table of a study": Reader(study, ("src/palpate/studies/sweeps/store.py",), ("points.parquet", "study.json",
                                                                                 "unwritten.jsonl")),
    "experiment": Reader(answers, ("src/palpate/studies/psychophysics/store.py",), ("a.tsv",)),
    "participants": Reader(participants, ("src/palpate/records/export/nwb.py",), ("participants.tsv",), OWN, True),
}  # fmt: skip
"""`src/palpate/records/lane_store.py` continues a store of the same ensemble; `tests/launch/test_lane_store.py`."""


def test_every_module_that_opens_a_file_is_a_tested_reader_or_says_why_not():
    tested = {place for reader in READERS.values() for place in reader.modules} | {"src/palpate/records/lane_store.py"}
    found = modules()
    assert found - tested - set(NO_READERS) == set(), "add it to READERS, or to NO_READERS with the reason"
    assert set(NO_READERS) - found == set(), "opens no file any more"
    assert {place for place in tested if not (ROOT / place).is_file()} == set()


# -- in a child with limits ------------------------------------------------------------------------------------------

MEMORY, PER_BYTE = 900 << 20, 400  # [bytes], [1] of memory; the process of meshio has 200
SECONDS, SECONDS_PER_BYTE = 40, 1e-4  # [s] of processor time


def confined(reader: Reader, path: Path) -> str:
    """The outcome of reading a file in a forked child whose memory and time are limited by the length of the file:
    "read", or the message. An exception that is not of the reader, too much memory or time fail."""
    size = sum(f.stat().st_size for f in (path.rglob("*") if path.is_dir() else [path]) if f.is_file())
    receive, send = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.close(receive)
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY + PER_BYTE * size,) * 2)
            seconds = int(time.process_time() + SECONDS + SECONDS_PER_BYTE * size)
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
            try:
                reader.read(path)
                text = "read"
            except reader.refuses as error:
                text = f"refused: {error}"
            except BaseException as error:
                text = f"failed: {type(error).__name__}: {error}"
            os.write(send, text.encode()[:4000])
        finally:
            os._exit(0)
    os.close(send)

    def late(*_: object) -> None:
        os.kill(child, signal.SIGKILL)

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(300)  # wall time: a reader that waits takes no processor time
    try:
        with os.fdopen(receive, "rb") as stream:
            text = stream.read().decode()
        _, status = os.waitpid(child, 0)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    assert text and not text.startswith("failed"), f"{path.name}: {text or f'ended by signal {status}'}"
    return text


@pytest.mark.parametrize("name", READERS)
def test_only_regular_files_are_opened(tmp_path, name):
    """A pipe, a device without an end, links to both, and a folder; a link to a regular file is one."""
    reader = READERS[name]
    for each in reader.names[:2]:
        for kind in ("pipe", "zero", "link to a pipe", "folder"):
            folder = tmp_path / kind.replace(" ", "-") / each.replace(".", "-")
            folder.mkdir(parents=True)
            path = folder / each
            if kind == "pipe":
                os.mkfifo(path)
            elif kind == "zero":
                path.symlink_to("/dev/zero")
            elif kind == "folder":
                path.mkdir()
            else:
                os.mkfifo(folder / "pipe")
                path.symlink_to(folder / "pipe")
            found = confined(reader, path)
            assert found.startswith("refused") or reader.quiet, (kind, found)


BOMBS: dict[str, tuple[str, Callable[[Path], None]]] = {}


def bomb(reader: str, name: str):
    """A small file that claims much: for which reader, and its name."""

    def add(write: Callable[[Path], None]) -> None:
        BOMBS[f"{reader}: {write.__name__.replace('_', ' ')}"] = reader, name, write

    return add


@bomb("organ", "a.ply")
def vertices_that_a_ply_file_lacks(path):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty double x\nproperty double y\n"
    path.write_bytes((head + "property double z\nend_header\n").encode() + bytes(100))


@bomb("organ", "a.ply")
def a_list_as_long_as_memory(path):
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += "element face 1\nproperty list uint double vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + bytes(12) + struct.pack("<I", 2**32 - 1) + bytes(100))


@bomb("organ", "a.ply")
def rows_without_properties(path):
    path.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 999999999999\nelement face 999999999999\nend_header\n")


@bomb("organ", "a.stl")
def triangles_that_an_stl_file_lacks(path):
    path.write_bytes(bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(1000))


@bomb("organ", "a.stl")
def one_word_among_many_corners(path):
    """Kept in a table of equal widths, its words would take 200 GB."""
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    path.write_bytes(
        b"solid\n" + 5000 * facet + facet.replace(b"vertex 0 1 0", b"vertex 0 1 " + b"x" * 4_000_000) + b"endsolid"
    )


@bomb("organ", "a.obj")
def one_long_number_among_many(path):
    path.write_bytes(b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\n" * 20_000 + b"f 1 2 3\nf 1 2 " + b"3" * 3_000_000)


@bomb("organ", "a.obj")
def materials_of_other_files(path):
    path.write_bytes(b"mtllib /dev/zero\nusemtl a\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")


@bomb("tetrahedra", "a.vtk")
def points_that_a_vtk_file_lacks(path):
    path.write_bytes(
        b"# vtk DataFile Version 4.2\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 400000000 double\n" + bytes(64)
    )


@bomb("tetrahedra", "a.msh")
def a_node_with_a_large_number(path):
    path.write_text("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n2000000000 0 0 1\n"
                    "$EndNodes\n$Elements\n1\n1 4 2 1 1 1 2 3 2000000000\n$EndElements\n")  # fmt: skip


@bomb("tetrahedra", "a.msh")
def nodes_that_a_msh_file_lacks(path):
    path.write_text("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n900000000\n1 0 0 0\n$EndNodes\n")


@bomb("tetrahedra", "a.vtu")
def blocks_that_unpack_to_much(path):
    import base64

    block, count = zlib.compress(bytes(1 << 20)), 800
    head = np.array([count, 1 << 20, 0] + [len(block)] * count, np.uint32).tobytes()
    data = base64.b64encode(head).decode() + base64.b64encode(block * count).decode()
    path.write_text(
        '<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        'header_type="UInt32" compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece NumberOfPoints="4" '
        'NumberOfCells="1"><Points><DataArray type="Float64" Name="Points" NumberOfComponents="3" format="binary">'
        f"{data}</DataArray></Points></Piece></UnstructuredGrid></VTKFile>"
    )


@bomb("tetrahedra", "a.inp")
def a_file_that_abaqus_includes(path):
    path.write_text("*NODE\n1,0,0,0\n*INCLUDE, INPUT=/etc/passwd\n")


@bomb("tetrahedra", "a.inp")
def a_pipe_that_abaqus_includes(path):
    os.mkfifo(path.parent / "pipe")
    path.write_text("*NODE\n1,0,0,0\n*INCLUDE, INPUT=pipe\n")


@bomb("tetrahedra", "a.xdmf")
def numbers_in_another_file(path):
    place = '<DataItem DataType="Float" Dimensions="4 3" Format="Binary" Precision="8">/etc/passwd</DataItem>'
    grid = f'<Grid Name="Grid"><Geometry GeometryType="XYZ">{place}</Geometry></Grid>'
    path.write_text(f'<Xdmf Version="3.0"><Domain>{grid}</Domain></Xdmf>')


@bomb("tetrahedra", "a.med")
def arrays_of_hdf5_without_numbers(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file.create_dataset("ENS_MAA/mesh/a", (400_000_000,), "f8", chunks=(1 << 16,))


@bomb("AFM", "a.h5")
def curves_without_rows(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        curve = file.create_group("0")
        for column in ("force", "height (measured)", "time", "segment"):
            curve.create_dataset(column, (300_000_000,), "f8", chunks=(1 << 16,))
    assert path.stat().st_size < 20_000


@bomb("AFM", "a.h5")
def a_curve_in_another_file(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["0"] = h5py.ExternalLink("/etc/passwd", "/")


@bomb("AFM", "a.jpk-force")
def a_zip_archive_that_unpacks_to_much(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for k in range(3):
            file.writestr(f"segments/{k}/channels/height.dat", bytes(100_000_000))


@bomb("AFM", "a.ibw")
def a_wave_with_many_points(path):
    path.write_bytes(struct.pack("<hhiiii", 5, 0, 400, 0, 0, 0) + bytes(44) + struct.pack("<i", 300_000_000) * 100)


def voxels_that_unpack(path):
    """270 million voxels in 0.6 MB."""
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, 650, 650, 640, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, 2, 8)
    struct.pack_into("<8f", head, 76, 1, 0.5, 0.5, 0.5, 1, 1, 1, 1)
    struct.pack_into("<f", head, 108, 352.0)
    head[344:348] = b"n+1\0"
    with gzip.open(path, "wb", compresslevel=9) as file:
        file.write(bytes(head))
        for _ in range(640):
            file.write(bytes(650 * 650))
    assert path.stat().st_size < 600_000


@bomb("scan", "a.nii.gz")
def voxels_that_unpack_to_much(path):
    voxels_that_unpack(path)


@bomb("segmentation", "a.nii.gz")
def labels_that_unpack_to_much(path):
    voxels_that_unpack(path)


@bomb("segmentation", "a.nii")
def labels_that_begin_far_away(path):
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, 5, 5, 5, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, 2, 8)
    struct.pack_into("<8f", head, 76, 1, 1, 1, 1, 1, 1, 1, 1)
    struct.pack_into("<f", head, 108, 3e12)
    head[344:348] = b"n+1\0"
    path.write_bytes(bytes(head) + bytes(200))


@bomb("segmentation", "a.nrrd")
def labels_that_an_nrrd_file_lacks(path):
    head = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 600 600 600\nspacings: 1 1 1\nencoding: gzip\n\n"
    path.write_bytes(head + gzip.compress(bytes(1000)))


@bomb("segmentation", "a.nrrd")
def voxels_of_another_file(path):
    path.write_bytes(b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 9 9 9\nspacings: 1 1 1\nencoding: raw\n"
                     b"data file: /dev/zero\n\n")  # fmt: skip


@bomb("segmentation", "a.mha")
def labels_that_a_metaimage_lacks(path):
    path.write_bytes(b"ObjectType = Image\nNDims = 3\nBinaryData = True\nCompressedData = True\nDimSize = 600 600 600\n"
                     b"CompressedDataSize = 99999999999\nElementSpacing = 1 1 1\nElementType = MET_DOUBLE\n"
                     b"ElementDataFile = LOCAL\n" + zlib.compress(bytes(1000)))  # fmt: skip


@bomb("segmentation", "a.mha")
def voxels_of_a_device(path):
    path.write_bytes(b"ObjectType = Image\nNDims = 3\nDimSize = 9 9 9\nElementSpacing = 1 1 1\n"
                     b"ElementType = MET_UCHAR\nElementDataFile = /dev/zero\n")  # fmt: skip


@bomb("segmentation", "a.dcm")
def frames_that_a_dicom_file_lacks(path):
    pytest.importorskip("pydicom")
    import pydicom
    from label_files import labels, write_dicom

    write_dicom(path, *labels(np.eye(3)))
    data = pydicom.dcmread(path)
    data.NumberOfFrames, data.Rows, data.Columns = 250, 1000, 1000
    data.save_as(path)


@bomb("sessions", "a.xlsx")
def a_workbook_that_unpacks_to_much(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("xl/worksheets/sheet1.xml", bytes(300_000_000))


@bomb("sessions", "a.xlsx")
def a_workbook_of_many_cells(path):
    openpyxl = pytest.importorskip("openpyxl")
    openpyxl.Workbook().save(path)
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    head, tail = members["xl/worksheets/sheet1.xml"].split(b"<sheetData", 1)
    row = b"<row>" + b"<c><v>1</v></c>" * 500 + b"</row>"
    rest = tail.split(b">", 1)[1].removeprefix(b"</sheetData>")
    members["xl/worksheets/sheet1.xml"] = head + b"<sheetData>" + row * 8000 + b"</sheetData>" + rest
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name, content)


@bomb("sessions", "a.mat")
def variables_that_unpack_to_much(path):
    savemat = pytest.importorskip("scipy.io").savemat
    savemat(path, {"force": np.zeros(40_000_000)}, do_compression=True)


@bomb("archive", "a.npz")
def an_array_larger_than_its_archive(path):
    with zipfile.ZipFile(path, "w") as file:
        head = "{'descr': '<f8', 'fortran_order': False, 'shape': (9000000000,), }".ljust(117) + "\n"
        file.writestr("a.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + bytes(64))


@bomb("basis", "a.npz")
def a_basis_of_more_vertices_than_compliances(path):
    np.savez_compressed(path, vertices=np.zeros((60_000, 3)), triangles=np.zeros((1, 3), int), step=1.0,
                        lower=np.zeros((2, 4), np.uint8))  # fmt: skip


@bomb("table of a study", "points.parquet")
def a_table_of_equal_rows(path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")

    rows = 30_000_000
    text = pyarrow.DictionaryArray.from_arrays(pyarrow.array(np.zeros(rows, np.int8)), pyarrow.array(["x" * 100]))
    parquet.write_table(pyarrow.table({"key": text}), path)
    assert path.stat().st_size < 1_000_000


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_file_takes_no_more_memory_or_time_than_its_length_allows(tmp_path, name):
    reader, file, write = BOMBS[name]
    write(tmp_path / file)
    found = confined(READERS[reader], tmp_path / file)
    assert found.startswith("refused") or name.endswith("materials of other files"), found
    assert str(tmp_path) in found or found == "read", found


# -- numbers from files that are indices -----------------------------------------------------------------------------


def vtk(value):
    head = (
        "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    )
    return f"{head}CELLS 1 5\n4 0 1 2 {value}\nCELL_TYPES 1\n10\n".encode()


def msh(value):
    return (f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n"
            f"$Elements\n1\n1 4 2 1 1 1 2 3 {value + 1}\n$EndElements\n").encode()  # fmt: skip


def inp(value):
    return f"*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT, TYPE=C3D4\n1,1,2,3,{value + 1}\n".encode()


def obj(value):
    number = value + 1 if value >= 0 else value - 4  # a negative one counts back from the last
    return f"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 {number}\nf 2 3 4\nf 1 4 3\n".encode()


def ply(value):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 4\n"
    rows = f"0 0 0\n.1 0 0\n0 .1 0\n0 0 .1\n3 0 2 1\n3 0 1 {value}\n3 1 2 3\n3 0 3 2\n"
    return f"{head}property list uchar int vertex_indices\nend_header\n{rows}".encode()


def shipped(name: str, array: str):
    """A shipped basis with one index of an array replaced."""

    def made(value):
        import io

        from palpate.nodes.deformation.basis_store import SHIPPED
        from palpate.physics.archive import read_arrays

        arrays = read_arrays(SHIPPED / name)
        changed = arrays[array].copy()
        count = {"triangles": len(arrays["vertices"]), "kept": 3 * len(arrays["vertices"]), "kinds": 3}[array]
        changed.flat[5] = {3: 1 if array == "kinds" else 3, 4: count}.get(value, value)
        stream = io.BytesIO()
        np.savez(stream, **(arrays | {array: changed}))
        return stream.getvalue()

    return made


INDICES = {
    "a.vtk": ("tetrahedra", vtk), "a.msh": ("tetrahedra", msh), "a.inp": ("tetrahedra", inp),
    "a.obj": ("organ", obj), "a.ply": ("organ", ply),
    "basis.npz": ("basis", shipped("sphere-condensed.npz", "triangles")),
    "sampled.npz": ("sampled basis", shipped("fingertip-sampled.npz", "triangles")),
    "sampled-kept.npz": ("sampled basis", shipped("fingertip-sampled.npz", "kept")),
    "sampled-laws.npz": ("sampled basis", shipped("fingertip-sampled.npz", "kinds")),
}  # fmt: skip
"""Files with an index of a table of four: how each is written with another index in its place."""
NO_INDICES = {
    "texture", "relief", "law", "graph", "named by a setting", "key", "firmware", "recorded presses", "AFM", "scan",
    "segmentation",
    "afferents", "archive", "fingertip", "region", "sessions", "motion", "pressing", "experiment", "participants",
}  # fmt: skip
"""Readers whose numbers are quantities. A recording: bodies check the vertices of each load (`nodes/base/contacts.py`),
pictures those of each surface; `tests/nodes/test_beyond_the_law.py`. A study: slots, `Store.curves`."""


@pytest.mark.parametrize("name", INDICES)
def test_an_index_that_its_table_does_not_have_is_refused(tmp_path, name):
    reader, write = INDICES[name]
    path = tmp_path / name
    path.write_bytes(write(3))
    assert confined(READERS[reader], path) == "read"
    for value in (-1, 4, 2**31 - 1):
        path.write_bytes(write(value))
        assert confined(READERS[reader], path).startswith("refused"), value


def test_every_reader_says_whether_its_numbers_are_indices():
    assert {reader for reader, _ in INDICES.values()} | NO_INDICES | {"recording", "table of a study"} == set(READERS)


def test_a_slot_of_a_study_that_its_curves_do_not_have_is_a_curve_of_nothing(tmp_path):
    zarr = pytest.importorskip("zarr")
    from palpate.studies.sweeps.store import Store

    group = zarr.open_group(tmp_path / "curves.zarr", mode="w")
    group.create_array("force", shape=(2, 3), chunks=(1, 3), dtype="float64")[:] = [[1, 2, 3], [4, 5, 6]]
    (tmp_path / "study.json").write_text(json.dumps({"bases": {}}))
    store = Store(tmp_path, write=False)
    np.testing.assert_array_equal(store.curves("force", [1, None, 0]), [[4, 5, 6], [np.nan] * 3, [1, 2, 3]])
    assert np.isnan(store.curves("force", [-1, 2, 99])).all()
    group.create_array("wide", shape=(2, 1 << 40), chunks=(1, 1 << 20), dtype="float64")
    with pytest.raises(PalpateError, match="2 curves of wide claims"):
        store.curves("wide", [0, 1])
