"""Python code between settings and messages calls nothing whose last bits depend on the processor.

`test_bits` checks the kernels. The sums and special functions that this code uses instead are compared with others.
"""

import ast
import math
import platform
from pathlib import Path

import mpmath
import numpy as np
import pytest
import scipy
from pytest import approx

from palpate.compiler.exact import cos, einsum, row_times, sin
from palpate.nodes.base.surface import rotation_matrix
from palpate.physics.contact.quantile import from_log_survival, log_survival
from palpate.physics.device.falcon import FALCON
from palpate.physics.nearest import nearest, tree_of
from palpate.physics.special import elliptic_integrals, gauss_legendre, patch_depth
from palpate.physics.texture.fourier import irfft, rfft

ROOT = Path(__file__).parents[2]
FOLDERS = ("src/palpate/physics", "src/palpate/engine", "src/palpate/compiler", "messages", "nodes")
C_LIBRARY = """acos acosh asin asinh atan atan2 atanh cbrt cos cosh erf erfc exp exp2 expm1 gamma lgamma log log1p log2
    log10 pow sin sinh tan tanh"""
"""Of `math`. Its `hypot` and `dist` are Python's, correct to the last bit."""
NUMPY = """arccos arccosh arcsin arcsinh arctan arctan2 arctanh cbrt convolve correlate cos cosh dot einsum exp exp2
    expm1 fft float_power geomspace hypot inner kron linalg log log10 log1p log2 logaddexp logspace matmul polyfit
    polynomial power roots sin sinc sinh tan tanh tensordot vdot vecdot"""
"""They call BLAS, LAPACK or the C library, approximate by the processor, or fuse products and sums on ARM."""
SCIPY = "fft integrate interpolate linalg ndimage optimize signal spatial special"
CALLED = {"math": set(C_LIBRARY.split()), "np": set(NUMPY.split()), "scipy": set(SCIPY.split())}
EXEMPT = {
    "messages/checks.py:": "the bits of the product are not used, only whether it is finite",
    "nodes/base/mesh_file.py:_near": "pairs of vertices by index; no distance is used",
    "nodes/base/texture_file.py:_on_triangles": "triangles by index",
    "nodes/sensor/measured.py:_press_bone": "an emulated sensor, which no replay computes",
    "src/palpate/compiler/angles.py:": "whole numbers, powers of 2, decimal numbers",
    "src/palpate/compiler/exponentials.py:": "the same",
    "src/palpate/engine/health.py:": "times, which differ in any case",
    "src/palpate/physics/afferents/probe.py:": "fits of nerve fibres",
    "src/palpate/physics/contact/layer.py:": "fits of a tissue",
    "src/palpate/physics/contact/tactile.py:equivalent_strain": "pictures and studies of full solutions",
    "src/palpate/physics/contact/tactile.py:tactile_flow": "the same",
    "src/palpate/physics/device/falcon.py:geometry": "constants, which a test compares",
    "src/palpate/physics/device/stability.py:": "studies of stability",
    "src/palpate/physics/device/stick.py:": "notes about a resting finger",
    **{
        f"src/palpate/physics/segmentation/{name}.py:": "makes a mesh file or nodule, by libraries that are not pinned"
        for name in ("backing", "boxed", "dicom", "image", "inclusion", "isosurface", "read", "smoothed", "surface")
    },
    "src/palpate/physics/materials/bone.py:_distances": "the nearest voxels by index; distances are computed there",
    "src/palpate/physics/table_books.py:matlab_lines": "a table of measurements, which no replay reads",
    "src/palpate/physics/display/shape_display.py:": "a power of whole numbers",
    "src/palpate/physics/fingertip/surfaces.py:level": "fingers from images",
    "src/palpate/physics/nearest.py:tree_of": "`nearest` uses only the indices that the tree finds",
    "src/palpate/physics/texture/autoregressive.py:line_spectrum": "fits of a texture",
    "src/palpate/physics/texture/autoregressive.py:spectrum": "the same",
    "src/palpate/physics/texture/autoregressive.py:yule_walker": "the same",
    "src/palpate/physics/texture/surface.py:third_octaves": "the same",
}
"""Places, a file and a function or a whole file, whose results no message contains."""


def compiled(node):
    names = (one.func if isinstance(one, ast.Call) else one for one in getattr(node, "decorator_list", ()))
    return any(ast.unparse(name) in ("kernel", "ieee_kernel", "inlined", "numba.njit") for name in names)


def in_python(node, function=""):
    """(node, name of its function) of everything in a syntax tree except compiled functions."""
    for child in ast.iter_child_nodes(node):
        if not compiled(child):
            name = child.name if isinstance(child, ast.FunctionDef) else function
            yield child, name
            yield from in_python(child, name)


def depends_on_the_processor(source):
    """(function, line, expression) of what code in Python must not call."""
    tree = ast.parse(source)
    allowed = {  # over an axis, numpy adds the squares without BLAS
        id(call.func.value)
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "np.linalg.norm"
        and any(given.arg == "axis" for given in call.keywords)
    }  # fmt: skip
    for node, function in in_python(tree):
        match node:
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                pass
            case ast.BinOp(op=ast.Pow(), right=ast.Constant(value=2)):
                continue
            case ast.BinOp(op=ast.Pow(), left=ast.Constant(), right=ast.Constant()):
                continue
            case ast.BinOp(op=ast.Pow()) | ast.AugAssign(op=ast.Pow()):
                pass
            case ast.Attribute(value=ast.Name(id=module), attr=name) if name in CALLED.get(module, ()):
                if id(node) in allowed:
                    continue
            case ast.Attribute(attr="dot"):
                pass
            case ast.ImportFrom(module=str(module)) if module.startswith(
                ("scipy.", "numpy.polynomial", "numpy.linalg")
            ):
                pass
            case ast.ImportFrom(module="math" | "numpy", names=names) if {n.name for n in names} & (
                CALLED["math"] | CALLED["np"]
            ):
                pass
            case _:
                continue
        yield function, node.lineno, ast.unparse(node)


def test_python_code_on_the_way_to_a_message_calls_nothing_that_depends_on_the_processor():
    """`np.einsum` at the start of the reduced body changed its last bits on ARM."""
    found, unused = [], set(EXEMPT)
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.resolve().relative_to(ROOT).as_posix()
            for function, line, text in depends_on_the_processor(path.read_text(encoding="utf-8")):
                places = {f"{name}:{function}", f"{name}:"} & set(EXEMPT)
                unused -= places
                if not places:
                    found.append(f"{name}:{line}: {text}")
    assert not found
    assert not unused


@pytest.mark.parametrize(
    "line", ["a @ b", "np.einsum('ij->i', a)", "np.linalg.norm(a)", "a ** 3", "a.dot(b)", "x **= 0.5",
             "scipy.special.ndtr(x)", "from scipy.special import ndtr", "math.exp(x)"],
)  # fmt: skip
def test_the_check_finds_these_calls(line):
    assert list(depends_on_the_processor(line))
    assert not list(depends_on_the_processor(f"@kernel\ndef f(a):\n    {line}"))
    assert list(depends_on_the_processor("from numpy.polynomial.legendre import leggauss"))
    assert not list(depends_on_the_processor("np.linalg.norm(a, axis=1) + a**2 + np.sqrt(a) + math.hypot(*b)"))


def test_the_constants_of_the_falcon_are_those_of_pinned_functions():
    """It computes them by the C library, since a graph is read without the compiler."""
    assert FALCON.geometry.cos_phi == tuple(cos(FALCON.phi).tolist())
    assert FALCON.geometry.sin_phi == tuple(sin(FALCON.phi).tolist())


@pytest.mark.parametrize(
    "pattern",
    """ij,ij->i ik,k->i ik,kj->ij ik,jk->ij aibk,lk->aibl ij,ajbk->aibk wa,wai->wi nqi,ji->nqj tj,rtj->rt eki,ekj->eij
    t,tai,tak->tki nq,nqi,nqj->nij pkc,pabc->pabk k,kj->j""".split(),  # noqa: SIM905
)
def test_sums_of_products_are_those_of_numpy(pattern):
    """To the last bit where numpy multiplies and adds separately, as on x86-64; the order is part of the results."""
    terms = pattern.partition("->")[0].split(",")
    for seed in range(4):
        rng = np.random.default_rng(seed)
        size = {name: 3 if name in "ijabcl" else int(rng.integers(1, 40)) for name in pattern if name.isalpha()}
        arrays = [rng.normal(size=[size[name] for name in term]) for term in terms]
        ours, theirs = einsum(pattern, *arrays), np.einsum(pattern, *arrays)
        assert ours == approx(theirs, rel=1e-13, abs=1e-13)
        assert platform.machine() != "x86_64" or np.array_equal(ours, theirs)


@pytest.mark.parametrize("count", [1, 2, 3, 8, 9, 17, 64])
def test_rows_are_summed_as_in_kernels(count):
    rows = np.random.default_rng(count).normal(size=(2, count))
    assert einsum("k,k->", *rows) == row_times(*rows)


@pytest.mark.parametrize("count", [1, 2, 3, 32, 33, 128, 400])
def test_quadrature_is_exact_for_polynomials(count):
    node, weight = gauss_legendre(count)
    theirs = np.polynomial.legendre.leggauss(count)
    assert node == approx(theirs[0], abs=3e-16) and weight == approx(theirs[1], rel=1e-9)
    for power in (0, 2 * count - 2):
        assert np.sum(weight * node**power) == approx(2.0 / (power + 1), rel=2e-13)
    assert np.array_equal(node, -node[::-1]) and not node.flags.writeable


def test_elliptic_integrals_and_the_depth_under_a_patch():
    mpmath.mp.dps = 40
    for complement in (1e-150, 1e-9, 1e-3, 0.2, 0.9, 1.0):
        first, second = elliptic_integrals(np.array([complement]))
        m = 1 - mpmath.mpf(complement) ** 2
        assert second[0] == approx(float(mpmath.ellipe(m)), rel=3e-15)
        assert complement < 1e-10 or first[0] == approx(float(mpmath.ellipk(m)), rel=3e-15)
    near = np.concatenate([1.0 - np.logspace(-15, 0, 30), [1.0], 1.0 + np.logspace(-15, 1.5, 40)])
    for rho, found in zip(near.tolist(), patch_depth(near).tolist(), strict=True):
        x = mpmath.mpf(rho)
        exact = 3.2 * mpmath.hyp2f1(0.5, -2.5, 1, x * x) if rho < 1 else mpmath.hyp2f1(0.5, 0.5, 4, 1 / x**2) / x
        assert found == approx(float(exact), rel=5e-15)


@pytest.mark.parametrize("freedom", [0.0, 0.5, 1.0, 5.0, 30.0, 1e3, 1e6])
def test_tails_and_quantiles_are_those_of_scipy(freedom):
    law = scipy.stats.t(freedom) if freedom else scipy.stats.norm
    for z in (-6.0, -1.5, -0.1, 0.0, 1e-3, 0.7, 1.99, 2.01, 4.0, 12.0):
        found = log_survival(z, freedom)
        assert math.exp(found) == approx(law.sf(z), rel=2e-10)
        assert from_log_survival(found, freedom) == approx(z, rel=1e-9, abs=1e-9)
    if freedom == 0.0:
        assert log_survival(40.0, 0.0) == approx(scipy.special.log_ndtr(-40.0), rel=1e-14)
    assert from_log_survival(0.0, freedom) == -math.inf


@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 100, 1000, 1024])
def test_transforms_are_those_of_numpy(count):
    x = np.random.default_rng(count).normal(size=count)
    lines = rfft(x)
    assert lines == approx(np.fft.rfft(x), abs=3e-15 * count)
    lines *= 1.0 + 0.5j
    assert irfft(lines, count) == approx(np.fft.irfft(lines, count), abs=1e-14)


def test_the_nearest_of_equally_distant_points_have_the_lowest_indices():
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0), [0.0], indexing="ij"), -1).reshape(-1, 3)
    away, found = nearest(tree_of(grid), np.array([[4.0, 4.0, 0.0], [0.5, 0.5, 1.0]]), 5)
    assert found.tolist() == [[40, 31, 39, 41, 49], [0, 1, 9, 10, 2]]
    assert away[0].tolist() == [0.0, 1.0, 1.0, 1.0, 1.0] and away[1, :4] == approx(math.sqrt(1.5), rel=1e-15)
    assert nearest(tree_of(grid[:3]), grid[:1], 9)[1].tolist() == [[0, 1, 2]]


def test_a_rotation_vector_turns_as_in_scipy():
    for vector in ((0.1, -0.2, 0.3), (3.0, 1.0, -2.0), (1e-4, 0.0, 2e-4), (0.0, 0.0, np.pi)):
        wanted = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
        assert rotation_matrix(vector) == approx(wanted, abs=5e-16)
