"""State has names: no kernel addresses the entries of an array by numbers that have a meaning.

A number has a meaning if it is a constant of a module (`memory[GAP]`), or a literal beyond the three axes of space
(`foot[8]`, `row[3 + k]`). Records (`compiler.fields`) have names instead. What remains is listed with its reason.
"""

import ast
from collections import defaultdict
from pathlib import Path

import pytest
from sources import tree_of

ROOT = Path(__file__).parents[1]
FOLDERS = ("messages", "nodes", "launch", "src/palpate")
KERNELS = {"kernel", "ieee_kernel", "inlined", "compiled"}
AXES = 3  # 0, 1 and 2 are x, y and z
LAW = "terminal law K, n, c, s_free, s_prev: a row of `Surface.laws`, whose form the message defines"
SLOPES = "a row of `Surface.slopes`: gradient (3) and shape operator (9), whose form the message defines"
WRENCH = "force and torque of a sensor, three axes each"
TENSOR = "components of a tensor or of derivatives, in the order of the docstring"
TIP = "law of a fingertip and its damping, whose form `physics.contact.series.kernel_form` defines"
STICK = "spring and damper of a friction without load, then their rise per newton: a row of the setting `sticks`"
SERIES = "coefficients of a formula, by their order"
FIELDS = "packed: work fields of the solver over the vertices or modes, named where they are unpacked; to be converted"
ROW = "packed: a row with several quantities; to be converted"
MOTION = "freedoms of rigid bodies: the axes of space for translation, then those for rotation of each body"
TABLES: dict[str, dict[str, str]] = {
    "launch/run/work/activity.py": {"fields": "fields of /proc/PID/stat, numbered by the kernel of Linux"},
    "nodes/base/contacts.py": {"law": LAW},
    "nodes/contact/carried.py": {
        "by": MOTION,
        "levers": MOTION,
        "own.sent": MOTION,
        "own.wrench": MOTION,
        "push": MOTION,
    },
    "nodes/contact/coupled_step.py": {"out": MOTION, "wrench": MOTION},
    "nodes/contact/finger.py": {"law": LAW, "heard": LAW},
    "nodes/contact/joint.py": {"laws": LAW, "terminal": LAW, "own.law": ROW},
    "nodes/contact/seen.py": {"fingertip": TIP},
    "nodes/contact/series.py": {"own.law": ROW},
    "nodes/contact/sum.py": {"lengths": ROW},
    "nodes/deformation/beam_bundle.py": {"bed.contacts.laws": LAW},
    "nodes/deformation/mass_spring.py": {"laws": LAW, "slopes": SLOPES},
    "nodes/deformation/reduced_answer.py": {"row": ROW, "slopes": SLOPES},
    "nodes/deformation/rigid.py": {"laws": LAW},
    "nodes/support.py": {"sticks": STICK},
    "nodes/sensor/force_torque.py": {"reported": WRENCH, "true": WRENCH},
    "nodes/tactile/relief.py": {"answer": TENSOR},
    "src/palpate/compiler/angles.py": {"a": SERIES},
    "src/palpate/compiler/exact.py": {"x": "eight equal partial sums"},
    "src/palpate/compiler/exponentials.py": {"ROOT_SERIES": SERIES},
    "src/palpate/drivers/hid/raw.py": {"rest": "numbers of a report of the device, after its axes"},
    "src/palpate/models/fe/contact/pair.py": {
        **dict.fromkeys(("value", "slope"), "the six nodes of a face"),
        **dict.fromkeys(("share", "spot"), "the six nodes of a face, after those of the other"),
    },
    "src/palpate/models/fe/sparse/cholesky.py": {"size": "arguments of LAPACK, passed by their address"},
    "src/palpate/physics/afferents/fibre.py": {"fibre.b": SERIES},
    "src/palpate/physics/afferents/population.py": {"s": TENSOR},
    "src/palpate/physics/bodies/beam_foundation_step.py": {"law": LAW},
    "src/palpate/physics/bodies/condensed_body.py": {"laws": LAW, "fields": FIELDS},
    "src/palpate/physics/bodies/condensed_contacts.py": {"fields": FIELDS, "room": FIELDS},
    "src/palpate/physics/bodies/condensed_field.py": {"fields": FIELDS},
    "src/palpate/physics/bodies/condensed_step.py": {"fields": FIELDS, "sums": ROW},
    "src/palpate/physics/bodies/floating/added_inertia.py": {"law": LAW, "tip": TIP, "stick": STICK},
    "src/palpate/physics/bodies/hat_distances.py": {"rule": "three barycentric coordinates of a point, and its weight"},
    "src/palpate/physics/bodies/mass_spring.py": {"out": SLOPES},
    "src/palpate/physics/bodies/patch.py": {"reach": ROW},
    "src/palpate/physics/bodies/place_energy.py": {"shape": TENSOR},
    "src/palpate/physics/bodies/sampled/contacts.py": {"fields": FIELDS, "vectors": FIELDS},
    "src/palpate/physics/bodies/sampled/solve.py": {"vectors": FIELDS},
    "src/palpate/physics/bodies/sampled/step.py": {"fields": FIELDS, "vectors": FIELDS},
    "src/palpate/physics/bodies/sampled_body.py": {"laws": LAW, "body.fields": FIELDS},
    "src/palpate/physics/bodies/floating/mobility.py": {"expected": MOTION},
    "src/palpate/physics/contact/organs/coupled.py": {"out": MOTION, "wrench": MOTION},
    "src/palpate/physics/contact/organs/pivoting.py": {
        "active.room": "rows of a workspace",
        "order": "four candidates, row by row",
    },
    "src/palpate/physics/contact/organs/between.py": dict.fromkeys(("out", "rows"), "four columns of a block"),
    "src/palpate/physics/contact/organs/rubbing_patch.py": dict.fromkeys(
        ("drags", "out"), "four candidates, row by row"
    ),
    "src/palpate/physics/contact/organs/rigid_motion.py": {
        "by": MOTION,
        "expected": MOTION,
        "levers": MOTION,
        "load": MOTION,
        "mobility": MOTION,
        "ride.ahead": MOTION,
        "ride.built": MOTION,
        "ride.load": MOTION,
        "ride.soft": MOTION,
    },
    "src/palpate/physics/contact/organs/backed.py": {"laws": LAW},
    "src/palpate/physics/contact/end_rate.py": {"rates": "the last four steps, the newest first"},
    "src/palpate/physics/contact/ledger.py": {"ledger.accounts": "the parts, in the order of `messages.ledger.PARTS`"},
    "src/palpate/physics/contact/series.py": {"finger": ROW},
    "src/palpate/physics/contact/subsurface.py": {"s": TENSOR},
    "src/palpate/physics/contact/tactile.py": {"values": "the four corners of a tetrahedron"},
    "src/palpate/physics/device/random_numbers.py": {"state": "the four words of the generator"},
    "src/palpate/physics/device/tracking.py": {"take(track, kind, t, reading, (x, y, z))": "a part of a result"},
    "src/palpate/physics/geometry/crossing.py": dict.fromkeys("ab", "low and negative high corner of a box, (6)"),
    "src/palpate/physics/geometry/newton.py": {"d": TENSOR},
    "src/palpate/physics/geometry/nurbs.py": dict.fromkeys(("d", "out", "work"), TENSOR),
    "src/palpate/physics/materials/mooney_rivlin.py": {"p": SERIES},
    "src/palpate/physics/materials/yeoh.py": {"p": SERIES},
    "src/palpate/studies/accuracy/chain.py": {"row": ROW},
    "src/palpate/studies/accuracy/reference.py": {"c": SERIES},
}
"""What remains: arrays of a file that are addressed by these numbers, with the reason."""
MOST_PACKED = 19  # of them that are to be converted


def constants(tree):
    """Constants of a module that are integers, by how they are numbered: one by one, or several in one assignment."""
    alone, numbered = set(), set()
    for node in tree.body:
        for target in node.targets if isinstance(node, ast.Assign) else ():
            names = [each.id for each in getattr(target, "elts", [target]) if isinstance(each, ast.Name)]
            values = getattr(node.value, "elts", [node.value] * len(names))
            if getattr(getattr(node.value, "func", None), "id", "") == "range":
                numbered |= {name for name in names if name.isupper()}
                continue
            found = {n for n, v in zip(names, values, strict=False) if n.isupper() and is_integer(v)}
            (numbered if len(names) > 1 else alone).update(found)
    return alone, numbered


def is_integer(node):
    return isinstance(node, ast.Constant) and type(node.value) is int


def is_kernel(node):
    if not isinstance(node, ast.FunctionDef):
        return False
    marks = [getattr(mark, "func", mark) for mark in node.decorator_list]
    return any(getattr(mark, "id", getattr(mark, "attr", "")) in KERNELS for mark in marks)


def places(nodes):
    """The array and each index of every subscript among these nodes."""
    for each in nodes:
        if isinstance(each, ast.Subscript) and getattr(each.value, "id", "") != "Annotated":
            indices = each.slice.elts if isinstance(each.slice, ast.Tuple) else [each.slice]
            for index in indices:
                if not isinstance(index, ast.Slice):
                    yield each.value, index


def parts(index):
    """An index, or both sides of a sum."""
    return [index.left, index.right] if isinstance(index, ast.BinOp) and isinstance(index.op, ast.Add) else [index]


def is_literal(index):
    return any(is_integer(part) and part.value >= AXES for part in parts(index))


def names(index):
    return {getattr(part, "id", getattr(part, "attr", "")) for part in parts(index)}


def numbered_places(trees):
    """Arrays of each file whose entries are addressed by numbers with a meaning: in kernels by any constant or literal,
    elsewhere by constants that number the entries of a list."""
    kinds = [constants(tree) for tree in trees.values()]
    alone, numbered = (set().union(*each) for each in zip(*kinds, strict=True))
    found = defaultdict(set)
    for file, tree in trees.items():
        nodes = list(ast.walk(tree))
        found[file] |= {ast.unparse(array) for array, index in places(nodes) if names(index) & numbered}
        for kernel in filter(is_kernel, nodes):
            found[file] |= {
                ast.unparse(array)
                for array, index in places(ast.walk(kernel))
                if names(index) & (alone | numbered) or is_literal(index)
            }
    return {file: arrays for file, arrays in found.items() if arrays}


def sources():
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py") if file.resolve() == file]
    return {file.relative_to(ROOT).as_posix(): tree_of(file) for file in files}


def test_every_array_that_is_addressed_by_numbers_is_listed_with_its_reason():
    trees = sources()
    assert len(trees) > 700
    found = numbered_places(trees)
    assert found == {file: set(arrays) for file, arrays in TABLES.items()}


def test_the_list_of_packed_rows_only_shrinks():
    packed = [reason for arrays in TABLES.values() for reason in arrays.values() if reason in (FIELDS, ROW)]
    assert len(packed) <= MOST_PACKED


@pytest.mark.parametrize(
    ("text", "array"),
    [
        ("GAP = 2\n@kernel\ndef f(memory):\n    memory[GAP] = 0.0", "memory"),
        ("A, B = 0, 1\ndef f(table):\n    return table[B]", "table"),
        ("A, B, C = range(3)\n@kernel\ndef f(table, k):\n    return table[k, A + k]", "table"),
        ("@kernel(nogil=True)\ndef f(foot):\n    return foot[8]", "foot"),
        ("@ieee_kernel\ndef f(row, k):\n    return row[k, 3 + k]", "row"),
        ("@kernels.kernel\ndef f(node):\n    return node.memory[5]", "node.memory"),
        ("class Node:\n    @compiled\n    def idle(node):\n        return node.memory[3]", "node.memory"),
    ],
)
def test_each_way_of_numbering_is_found(text, array):
    assert numbered_places({"file": ast.parse(text)}) == {"file": {array}}


@pytest.mark.parametrize(
    "text",
    [
        "@kernel\ndef f(p):\n    return p[0] + p[1] + p[2]",
        "@kernel\ndef f(p, k):\n    return p[k] + p[k + 1] + p[(k + 1) % 3] + p[2 * k + 1]",
        "MOST = 5\ndef f(rows):\n    return rows[:MOST], rows[MOST]",
        "def f(rows):\n    return rows[7]",
    ],
)
def test_axes_neighbours_and_plain_python_are_no_state(text):
    assert numbered_places({"file": ast.parse(text)}) == {}
