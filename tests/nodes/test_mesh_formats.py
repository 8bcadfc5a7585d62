"""Mesh files as other programs write them: each is read right, or refused with its cause; cut files are noticed."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from polygon_files import L_SHAPE, as_obj, as_ply, prism

from palpate.nodes.base import SettingError
from palpate.nodes.base.mesh_file import flaws
from palpate.nodes.base.mesh_formats import FORMATS, read_file
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.indices import check_indices

trimesh = pytest.importorskip("trimesh")

PAGE = Path(__file__).parents[2] / "docs" / "your_organ.md"
POINTS, FACES = prism(L_SHAPE, 30.0)
MIXED = [[*face] for face in FACES[2:]] + [FACES[0][::1], FACES[1]]  # quads and hexagons
BOX = trimesh.creation.box((40.0, 30.0, 20.0))
BALL = trimesh.creation.icosphere(2, 30.0)


def corners_of(path, data):
    path.write_bytes(data)
    vertices, triangles, notes, cut = read_file(str(path))
    return vertices[triangles], notes, cut


def refused(path, data):
    path.write_bytes(data)
    with pytest.raises(SettingError) as caught:
        read_file(str(path))
    assert "\n" not in str(caught.value) and path.name in str(caught.value)
    return str(caught.value)


# -- as other programs write them --------------------------------------------------------------------------------------

PLAIN = as_obj(POINTS, FACES)
OBJ = {
    "tabs": PLAIN.replace(b" ", b"\t"),
    "a byte order mark": b"\xef\xbb\xbf" + PLAIN,
    "a comment after a face": re.sub(rb"(f .*)\n", rb"\1 # a face\n", PLAIN),
    "a comment without a space": re.sub(rb"(f .*)\n", rb"\1#a face\n", PLAIN),
    "CR": PLAIN.replace(b"\n", b"\r"),
    "CR LF": PLAIN.replace(b"\n", b"\r\n"),
    "empty lines": PLAIN.replace(b"\n", b"\n\n  \n"),
    "indented": PLAIN.replace(b"\n", b"\n   "),
    "continued lines": PLAIN.replace(b"f ", b"f \\\n"),
    "colours": re.sub(rb"(v .*)\n", rb"\1 0.5 0.5 0.5\n", PLAIN),
    "weights": re.sub(rb"(v .*)\n", rb"\1 1.0\n", PLAIN),
    "groups, smoothing, lines": b"o L\ng a b\ns off\nl 1 2\n" + PLAIN,
    "names that begin with f and v": b"foo 1 2\nfar\nvp 1 2\nvolume 3\n" + PLAIN,
    "an old face": PLAIN.replace(b"f ", b"fo "),
    "textures": b"vt 0 0\n" + as_obj(POINTS, FACES, "{0}/1"),
    "normals": b"vn 0 0 1\n" + as_obj(POINTS, FACES, "{0}//1"),
    "textures and normals": b"vt 0 0\nvn 0 0 1\n" + as_obj(POINTS, FACES, "{0}/1/1"),
    "indices from the end": b"".join(
        [PLAIN.partition(b"f ")[0]]
        + [b"f " + " ".join(str(k - len(POINTS)) for k in face).encode() + b"\n" for face in FACES]
    ),
    "no end of the last line": PLAIN.rstrip(),
}
"""An OBJ file of the L in each form that is read."""


@pytest.mark.parametrize("form", OBJ)
def test_an_obj_file_of_each_form_is_read(tmp_path, form):
    plain, _, _ = corners_of(tmp_path / "plain.obj", PLAIN)
    found, notes, _ = corners_of(tmp_path / "given.obj", OBJ[form])
    np.testing.assert_array_equal(found, plain)
    assert notes == []


def ply(head: str, body: bytes, eol: bytes = b"\n") -> bytes:
    return b"ply\n".replace(b"\n", eol) + head.encode().replace(b"\n", eol) + b"end_header" + eol + body


def strips() -> tuple[list[int], np.ndarray]:
    """A tetrahedron of two strips with a restart, and its triangles."""
    return [0, 1, 2, 3, -1, 0, 3, 1, -1, 0, 2, 3], np.array([[0, 1, 2], [2, 1, 3], [0, 3, 1], [0, 2, 3]])


TETRAHEDRON = np.array([(0, 0, 0), (0, 20, 0), (20, 0, 0), (0, 0, 20)], float)
FOUR = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
VERTEX = "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("eol", [b"\n", b"\r\n", b"\r"])
def test_a_ply_file_of_triangles_quads_and_polygons_is_read(tmp_path, form, eol):
    """As Blender writes it, with the ends of lines of each system; binary rows that begin with a line feed too."""
    plain, _, _ = corners_of(tmp_path / "plain.obj", PLAIN)
    points = POINTS.copy()
    points[0, 0] = np.frombuffer(b"\n" * 8, "<f8")[0]  # 1e-257
    head, _, body = as_ply(points, FACES, form).partition(b"end_header\n")
    body = body.replace(b"\n", eol) if form == "ascii" else body
    found, notes, _ = corners_of(tmp_path / "given.ply", head.replace(b"\n", eol) + b"end_header" + eol + body)
    np.testing.assert_allclose(found, plain, atol=1e-12)
    assert notes == []


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_strips_of_triangles_are_read(tmp_path, form):
    strip, triangles = strips()
    head = f"format {form} 1.0\n{VERTEX.format(4)}element tristrips 1\nproperty list int int vertex_indices\n"
    if form == "ascii":
        body = "\n".join(" ".join(map(str, row)) for row in TETRAHEDRON).encode()
        body += f"\n{len(strip)} {' '.join(map(str, strip))}\n".encode()
    else:
        body = TETRAHEDRON.astype("<f4").tobytes() + struct.pack(f"<{1 + len(strip)}i", len(strip), *strip)
    found, notes, _ = corners_of(tmp_path / "given.ply", ply(head, body))
    np.testing.assert_array_equal(found, TETRAHEDRON[triangles])
    assert notes == []


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_what_follows_the_last_element_is_ignored_and_counted(tmp_path, form):
    whole = as_ply(POINTS, FACES, form)
    plain, _, _ = corners_of(tmp_path / "plain.ply", whole)
    found, notes, _ = corners_of(tmp_path / "given.ply", whole + b"and more\n")
    np.testing.assert_array_equal(found, plain)
    assert notes == [f"{'1 lines' if form == 'ascii' else '9 bytes'} after its last element are ignored"]


@pytest.mark.parametrize("word", ["-1.#IND", "1.#QNAN", "-nan(ind)", "nan"])
def test_properties_of_a_text_ply_file_that_are_not_read_may_be_no_numbers(tmp_path, word):
    """Normals of triangles without area, as a program on Windows writes them; in a coordinate the word is refused."""
    plain, _, _ = corners_of(tmp_path / "plain.obj", as_obj(TETRAHEDRON, FOUR))
    head = f"format ascii 1.0\n{VERTEX.format(4)}property float nx\nelement face 4\n"
    head += "property list uchar int vertex_indices\nproperty float quality\n"
    body = "".join(f"{x} {y} {z} {word}\n" for x, y, z in TETRAHEDRON)
    body += "".join(f"3 {a} {b} {c} {word}\n" for a, b, c in FOUR)
    found, notes, _ = corners_of(tmp_path / "given.ply", ply(head, body.encode()))
    np.testing.assert_array_equal(found, plain)
    assert notes == []
    path = tmp_path / "wrong.ply"
    path.write_bytes(ply(head, body.replace("20.0", word, 1).encode()))
    with pytest.raises(SettingError, match="not a finite number: vertex 2"):
        surface_mesh(str(path), 0, file_unit="mm")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("ending", [".obj", ".ply", ".stl"])
def test_a_byte_order_mark_of_a_text_is_read(tmp_path, ending, encoding):
    data = READ[ending]["polygons" if ending == ".obj" else "text"]
    plain, _, _ = corners_of(tmp_path / f"plain{ending}", data)
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    found, notes, _ = corners_of(tmp_path / f"given{ending}", (mark + data.decode()).encode(encoding))
    np.testing.assert_array_equal(found, plain)
    assert notes == []


PLY_TYPES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}


def random_ply(rng) -> tuple[bytes, np.ndarray]:
    """The box in a PLY file of random layout, and the corners of its triangles: further elements before, between and
    after, properties and lists around those that are read, types, forms, names."""
    order = rng.choice(["", "<", ">"])
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]

    def extra(name):
        return [(f"{name}{k}", rng.choice(list(PLY_TYPES)), rng.choice(["", "", "uchar", "int"])) for k in
                range(rng.integers(0, 3))]  # fmt: skip

    def value(kind):
        return float(rng.integers(0, 100)) if kind in ("float", "double") else int(rng.integers(0, 100))

    real, whole = rng.choice(["float", "double"]), rng.choice(["int", "uint", "short", "uchar"])
    corners = (rng.choice(["vertex_index", "vertex_indices"]), whole, rng.choice(["uchar", "int", "ushort"]))
    layout = [
        ("vertex", len(BOX.vertices), [*extra("a"), ("x", real, ""), *extra("b"), ("y", real, ""), ("z", real, ""),
                                       *extra("c")]),
        ("face", len(BOX.faces), [*extra("d"), corners, *extra("e")]),
    ]  # fmt: skip
    for name in ("edge", "material", "camera"):
        layout.insert(rng.integers(0, len(layout) + 1), (name, int(rng.integers(0, 4)), extra("f")))
    head, body = f"format {form} 1.0\ncomment random\n", b""
    for name, count, properties in layout:
        head += f"element {name} {count}\n"
        for each, kind, length in properties:
            head += f"property {f'list {length} ' if length else ''}{kind} {each}\n"
        for row in range(count):
            words = []
            for each, kind, length in properties:
                if name == "vertex" and each in "xyz":
                    given = [(kind, float(BOX.vertices[row]["xyz".index(each)]))]
                elif each == corners[0]:
                    given = [(length, 3), *((kind, int(k)) for k in BOX.faces[row])]
                elif length:
                    entries = int(rng.integers(0, 4))
                    given = [(length, entries), *((kind, value(kind)) for _ in range(entries))]
                else:
                    given = [(kind, value(kind))]
                words += given
            if order:
                body += b"".join(struct.pack(order + PLY_TYPES[kind], number) for kind, number in words)
            elif words:
                body += " ".join(str(number) for _, number in words).encode() + b"\n"
    return ply(head, body), np.asarray(BOX.vertices)[BOX.faces]


def test_ply_files_of_random_layouts_are_read(tmp_path):
    """400 files."""
    for seed in range(400):
        data, expected = random_ply(np.random.default_rng(seed))
        found, notes, _ = corners_of(tmp_path / "given.ply", data)
        np.testing.assert_array_equal(found, expected, err_msg=f"seed {seed}")
        assert notes == [], seed


@pytest.mark.parametrize("normal", ["-1.#IND -1.#IND -1.#IND", "nan nan nan", "1.#QNAN 0 0", "", "0,5 0,5 0"])
def test_normals_of_a_text_stl_file_are_not_read(tmp_path, normal):
    text = BALL.export(file_type="stl_ascii")
    plain, _, _ = corners_of(tmp_path / "plain.stl", text.encode())
    found, notes, _ = corners_of(tmp_path / "given.stl", re.sub("normal .*", f"normal {normal}", text).encode())
    np.testing.assert_array_equal(found, plain)
    assert notes == []


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("k.stl", {}),
        ("t.stl", {"file_type": "stl_ascii"}),
        ("k.ply", {}),
        ("k.obj", {}),
        ("n.obj", {"include_normals": True}),
    ],
)
def test_files_of_trimesh_are_read_as_it_reads_them(tmp_path, name, how):
    """Of text, all digits are read, where trimesh rounds some to 32 bits."""
    BALL.export(tmp_path / name, **how)
    theirs = trimesh.load(tmp_path / name, process=False)
    vertices, triangles, notes, _ = read_file(str(tmp_path / name))
    order = [np.lexsort(np.round(c.mean(axis=1), 6).T) for c in (vertices[triangles], theirs.triangles)]
    np.testing.assert_array_equal(vertices[triangles][order[0]], theirs.triangles[order[1]])
    assert notes == []


# -- wrong or cut off ------------------------------------------------------------------------------------------------

WRONG = {
    ("k.obj", "has the vertex 0; vertices are numbered from 1"): re.sub(rb"f \d+ ", b"f 0 ", PLAIN, count=1),
    ("k.obj", r"has the vertex 99, the file has 12"): re.sub(rb"f \d+ ", b"f 99 ", PLAIN, count=1),
    ("k.obj", r"has the vertex -13; 12 are before"): re.sub(rb"f \d+ ", b"f -13 ", PLAIN, count=1),
    ("k.obj", r"found the corner '1.5'"): re.sub(rb"f \d+ ", b"f 1.5 ", PLAIN, count=1),
    ("k.obj", r"found the corner '9+\.\.\.'"): re.sub(rb"f \d+ ", b"f " + b"9" * 100 + b" ", PLAIN, count=1),
    ("k.obj", r"line 13 is 'f 1 2', expected `f` and three"): PLAIN.replace(b"f ", b"f 1 2\nf ", 1),
    ("k.obj", r"vertex 1 has the coordinate '0,5'"): PLAIN.replace(b"v 0.0", b"v 0,5", 1),
    ("k.obj", "12 vertices and no faces"): PLAIN.partition(b"f ")[0],
    ("k.obj", "it has no vertices, lines such as `v"): b"# a comment\no ball\n",
    ("k.stl", "it has 2 facets and 5 corners, expected 6: it is cut off"): (
        b"solid a\n" + b"".join(b"facet normal 0 0 1\nouter loop\n" + b"vertex 0 1 2\n" * corners
                                + b"endloop\nendfacet\n" for corners in (3, 2)) + b"endsolid\n"
    ),
    ("k.ply", r"a face has the vertex -1, expected 0 to 11"): as_ply(POINTS, [[-1, 1, 2]]),
    ("k2.ply", r"a face has the vertex -1, expected 0 to 11"): as_ply(POINTS, [[-1, 1, 2]], "binary_big_endian"),
    ("k.ply", r"a face has the vertex 12, expected 0 to 11"): as_ply(POINTS, [[0, 1, 12]]),
    ("k.ply", r"a face has the vertex 1.5"): as_ply(POINTS, [[0, 1, 2]]).replace(b"3 0 1 2", b"3 0 1.5 2"),
    ("k.ply", r"row 2 of vertex is '0 0', expected 3 numbers"): ply(
        f"format ascii 1.0\n{VERTEX.format(3)}element face 1\nproperty list uchar int vertex_indices\n",
        b"0 0 0\n0 0\n1 1 1\n3 0 1 2\n",
    ),
    ("k.ply", "no faces: it is a cloud of points"): ply(f"format ascii 1.0\n{VERTEX.format(1)}", b"0 0 0\n"),
    ("k.ply", "element vertex has no y, z"): ply(
        "format ascii 1.0\nelement vertex 1\nproperty float x\n", b"0\n"
    ),
    ("k.ply", "'format text 1.0', which is not one of"): b"ply\nformat text 1.0\nend_header\n",
    ("k.ply", "has the line 'property float128 x'"): ply(
        "format ascii 1.0\nelement vertex 1\nproperty float128 x\n", b"0\n"
    ),
    ("k.ply", "announces 1000000000 rows of vertex, the file has room for 1"): ply(
        f"format binary_little_endian 1.0\n{VERTEX.format(10**9)}", bytes(12)
    ),
    ("k.ply", "announces 1000000000 rows of face, the file has room for"): ply(
        f"format binary_little_endian 1.0\n{VERTEX.format(1)}element face {10**9}\n"
        "property list int int vertex_indices\n", bytes(12) + struct.pack("<i", 2**31 - 1),
    ),
    ("k.ply", "row 1 of face has a list of -5 entries"): ply(
        f"format binary_little_endian 1.0\n{VERTEX.format(1)}element face 1\nproperty list int int vertex_indices\n",
        bytes(12) + struct.pack("<i", -5),
    ),
    ("k.stl", "the corner '-1.#IND 0 0' is not three numbers"): (
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex -1.#IND 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "text"), WRONG)
def test_a_wrong_file_is_refused_with_its_cause(tmp_path, name, text):
    assert re.search(text, refused(tmp_path / name, WRONG[name, text]))


CUT = {
    "text.ply": as_ply(np.asarray(BALL.vertices), BALL.faces.tolist()),
    "binary.ply": as_ply(np.asarray(BALL.vertices), BALL.faces.tolist(), "binary_little_endian"),
    "a.obj": as_obj(np.asarray(BALL.vertices), BALL.faces.tolist()),
    "separate.obj": b"".join(  # each triangle after its corners, counted back from there
        "v {} {} {}\nv {} {} {}\nv {} {} {}\nf -3 -2 -1\n".format(*corners.ravel()).encode()
        for corners in BALL.triangles
    ),
    "text.stl": BALL.export(file_type="stl_ascii").encode(),
    "binary.stl": BALL.export(file_type="stl"),
}


@pytest.mark.parametrize("name", CUT)
def test_a_file_of_a_closed_body_that_is_cut_off_anywhere_is_refused_or_reported_as_cut(tmp_path, name):
    """60 places each. Where a file may end there, it has fewer triangles and is open, and the line gives the reason."""
    data, path = CUT[name], tmp_path / name
    path.write_bytes(data)
    assert flaws(str(path)) == []
    whole = len(read_file(str(path))[1])
    found = {"refused": 0, "reported": 0}
    for place in np.linspace(0.02, 0.999, 60):
        path.write_bytes(data[: int(place * len(data))])
        try:
            lines = flaws(str(path))
        except SettingError as error:
            found["refused"] += 1
            assert re.search("cut off|no triangles|has only|point or a line", str(error)), error
        else:
            found["reported"] += 1
            assert any("cut off" in line or "instead of `endsolid`" in line for line in lines), (place, lines)
            assert len(read_file(str(path))[1]) <= whole
    expected = {"text.stl": 1, "a.obj": 1, "separate.obj": 1, "text.ply": 0}
    assert found["reported"] >= expected.get(name, 0)
    if name in ("binary.ply", "binary.stl"):
        assert found["refused"] == 60


def test_the_checker_of_indices_refuses_all_but_whole_numbers_in_range():
    np.testing.assert_array_equal(check_indices([[0, 2.0]], 3, "found"), [[0, 2]])
    assert check_indices(np.array([-1, 2], np.int16), 3, "found", least=-1).dtype == np.int64
    assert check_indices(np.zeros(0), 0, "found").shape == (0,)
    for wrong in (
        [-1],
        [3],
        [0.5],
        [np.nan],
        [np.inf],
        [2**63],
        np.array([2**64 - 1], np.uint64),
        ["1"],
        [None],
        [True],
    ):
        with pytest.raises(ValueError, match=r"^found"):
            check_indices(np.array(wrong), 3, "found")
    with pytest.raises(ValueError, match="expected none"):
        check_indices([0], 0, "found")


# -- the page --------------------------------------------------------------------------------------------------------

PLAIN_PLY = as_ply(POINTS, FACES)
STL_TEXT = BOX.export(file_type="stl_ascii").encode()
STL = BOX.export(file_type="stl")
READ = {
    ".stl": {
        "binary": STL,
        "text": STL_TEXT,
        "normals that are no numbers": re.sub(rb"normal .*", b"normal -1.#IND 0 0", STL_TEXT),
        "a count of 0": STL[:80] + bytes(4) + STL[84:],
        "trailing bytes": STL + b"more",
        "no last line": STL_TEXT.rpartition(b"endsolid")[0],
        "a byte order mark": b"\xef\xbb\xbf" + STL_TEXT,
        "several solids": STL_TEXT.rstrip() + b"\n" + STL_TEXT,
    },
    ".ply": {
        "text": PLAIN_PLY,
        "binary, little-endian": as_ply(POINTS, FACES, "binary_little_endian"),
        "binary, big-endian": as_ply(POINTS, FACES, "binary_big_endian"),
        "triangles and quads": as_ply(
            POINTS, [FACES[2], *([a, b, c] for a, b, c, _ in FACES[3:])], "binary_little_endian"
        ),
        "polygons": PLAIN_PLY,
        "strips of triangles": ply(
            f"format ascii 1.0\n{VERTEX.format(3)}element tristrips 1\nproperty list int int vertex_indices\n",
            b"0 0 0\n0 1 0\n1 0 0\n3 0 1 2\n",
        ),
        "other elements and properties": random_ply(np.random.default_rng(0))[0],
        "normals that are no numbers": ply(
            f"format ascii 1.0\n{VERTEX.format(3)}property float nx\nelement face 1\n"
            "property list uchar int vertex_indices\n",
            b"0 0 0 -1.#IND\n0 1 0 0\n1 0 0 nan\n3 0 1 2\n",
        ),
        "a byte order mark": b"\xef\xbb\xbf" + PLAIN_PLY,
        "trailing bytes": PLAIN_PLY + b"more\n",
        "lines that end with CR": PLAIN_PLY.replace(b"\n", b"\r"),
        "lines that end with CR LF": PLAIN_PLY.replace(b"\n", b"\r\n"),
    },
    ".obj": {
        "polygons": PLAIN,
        "textures and normals": OBJ["textures and normals"],
        "indices from the end": OBJ["indices from the end"],
        "tabs": OBJ["tabs"],
        "a byte order mark": OBJ["a byte order mark"],
        "a comment after a face": OBJ["a comment after a face"],
        "continued lines": OBJ["continued lines"],
        "colours of vertices": OBJ["colours"],
        "names of groups and materials": b"mtllib a.mtl\nusemtl a\n" + OBJ["groups, smoothing, lines"],
        "lines that end with CR": OBJ["CR"],
        "lines that end with CR LF": OBJ["CR LF"],
    },
}
REFUSED = {
    ".stl": {
        "a corner that is no number": re.sub(rb"vertex \S+", b"vertex 1.#QNAN", STL_TEXT, count=1),
        "fewer triangles than its header announces": STL[:-10],
    },
    ".ply": {
        "fewer rows than its header announces": PLAIN_PLY[:-30],
        "a face with a vertex that does not exist": as_ply(POINTS, [[0, 1, 99]]),
        "points without faces": ply(f"format ascii 1.0\n{VERTEX.format(1)}", b"0 0 0\n"),
    },
    ".obj": {
        "a vertex 0": PLAIN + b"f 0 1 2\n",
        "a face with a vertex that does not exist": PLAIN + b"f 1 2 99\n",
        "a face of two corners": PLAIN + b"f 1 2\nf 1 2 3\n",
        "points without faces": PLAIN.partition(b"f ")[0],
    },
}


def listed() -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """By format, what the page says is read, and what is refused."""
    text = PAGE.read_text(encoding="utf-8").partition("## What is read")[2].partition("\n## ")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| `")]
    read, refused_ = ({row[0].strip("`"): set(row[k].split("; ")) for row in rows} for k in (1, 2))
    return read, refused_


def test_the_page_lists_what_is_read_and_what_is_refused(tmp_path):
    read, not_read = listed()
    assert read == {ending: set(forms) for ending, forms in READ.items()}
    assert not_read == {ending: set(forms) for ending, forms in REFUSED.items()}
    assert set(read) == set(FORMATS)
    for ending, forms in READ.items():
        for form, data in forms.items():
            assert len(corners_of(tmp_path / f"a{ending}", data)[0]), form
    for ending, forms in REFUSED.items():
        for data in forms.values():
            refused(tmp_path / f"a{ending}", data)
