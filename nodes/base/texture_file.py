"""A texture as autoregressive models over sliding speed and normal force: its file, and interpolation between them."""

import math
import xml.etree.ElementTree as tree
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum
from palpate.physics.nearest import nearest, tree_of
from palpate.physics.readable import check_readable
from palpate.physics.texture.autoregressive import coefficients, innovation

GRID = 24
"""Nodes of the table along speed and along force."""
LARGEST = 32 << 20
"""[B] of a file."""
ROUNDING = 1e-12
"""[1] Of a barycentric coordinate, so that no place is between two triangles."""
Positive = Annotated[float, msgspec.Meta(gt=0)]


class Model(msgspec.Struct, frozen=True, kw_only=True):
    """The vibration at one speed and force.

    speed [m/s]   force [N], normal   lsf [rad] (p) line spectral frequencies   rms: of the vibration, in its unit
    interval  95 % of the rms
    """

    speed: Positive
    force: Positive
    rms: Annotated[float, msgspec.Meta(ge=0)]
    lsf: tuple[float, ...]
    interval: tuple[float, float] | None = None


class Texture(msgspec.Struct, frozen=True, kw_only=True):
    """Models of one order at a sampling rate [Hz] of a force [N] or an acceleration [m/s^2].

    held_out  speed that was not fitted [m/s], and [Hz, dB] error of the prediction in third-octave bands
    """

    sampling: Positive
    quantity: str
    models: tuple[Model, ...]
    held_out: tuple[float, tuple[tuple[float, float], ...]] | None = None


def read_texture(path: Path) -> Texture:
    """A file of `palpate fit texture` (JSON), or a model set of the Penn Haptic Texture Toolkit (XML).

    OSError, ValueError: cannot be read; says what is wrong.
    """
    check_readable(path, LARGEST)
    data = path.read_bytes()
    found = _penn(data) if data.lstrip()[:1] == b"<" else msgspec.json.decode(data, type=Texture)
    if found.quantity not in ("force", "acceleration"):
        raise ValueError(f"quantity: found {found.quantity!r}, expected force or acceleration")
    for number, model in enumerate(found.models):
        angles = np.array([0.0, *model.lsf, np.pi])
        if not model.lsf or len(model.lsf) != len(found.models[0].lsf) or not np.all(np.diff(angles) > 0.0):
            raise ValueError(f"model {number}: expected {len(found.models[0].lsf)} line spectral frequencies that rise "
                             "between 0 and pi")  # fmt: skip
    if not found.models:
        raise ValueError("it has no model")
    return found


def _penn(data: bytes) -> Texture:
    """Read a model set: speeds in mm/s, accelerations in m/s^2, `var` is the variance of the residual."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("an XML file with entities; expected a model set without")
    try:
        root = tree.fromstring(data)
        if float(root.findtext("numMACoeff") or 0):
            raise ValueError("it has moving-average coefficients; expected autoregressive models")
        models = []
        for each in root.iter("model"):
            speed, force, variance = (float(each.findtext(name) or "") for name in ("speedMod", "forceMod", "var"))
            lsf = np.array([float(value.text or "") for value in each.findall("ARlsf/value")])
            if speed <= 0.0 or force <= 0.0 or not len(lsf):
                continue  # the rims of the triangulation, at rest or without force
            a, work = np.zeros(len(lsf)), np.zeros((2, len(lsf) + 2))
            coefficients(lsf, work[0], work[1], a)
            gain = innovation(a, work[0])
            rms = math.sqrt(max(variance, 0.0)) / gain if gain > 0.0 else 0.0
            models.append(Model(speed=1e-3 * speed, force=force, rms=rms, lsf=tuple(lsf)))
        sampling = float(root.findtext("SampleRate") or "")
    except (tree.ParseError, ValueError) as error:
        raise ValueError(f"not a model set of the Penn Haptic Texture Toolkit: {error}") from None
    return Texture(sampling=sampling, quantity="acceleration", models=tuple(models))


def tabulate_texture(texture: Texture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(speeds (n), forces (m), table (n, m, p + 1)) of LSF and rms: linear on the triangles of the models' speeds and
    forces, with the nearest node outside of them; along the line of models in a row. Each row is a weighted mean of
    models, so it is stable."""
    at = np.array([(model.speed, model.force) for model in texture.models])
    values = np.array([(*model.lsf, model.rms) for model in texture.models])
    speeds, forces = (np.unique([at[:, i].min(), *np.linspace(at[:, i].min(), at[:, i].max(), GRID)]) for i in (0, 1))
    x, y = np.meshgrid(speeds, forces, indexing="ij")
    size = at.max(axis=0)
    nodes = np.column_stack([x.ravel(), y.ravel()]) / size
    known = at / size
    (a, b), (_, c) = einsum("ki,kj->ij", known - known[0], known - known[0])
    if a * c - b * b <= 1e-12 * (a + c):  # all in a row
        table = _in_a_row(known, values, nodes)
    else:
        table, inside = _on_triangles(known, values, nodes)
        table[~inside] = table[inside][nearest(tree_of(nodes[inside]), nodes[~inside])[1][:, 0]]
    return speeds, forces, table.reshape(len(speeds), len(forces), -1)


def _in_a_row(known: np.ndarray, values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (n,p) at places (n,2), linear along the line of the points `known` (m,2) with `values` (m,p): of the
    nearest place of the line."""
    away = known - known[0]
    far = away[np.argmax((away * away).sum(axis=1))]
    along, wanted = (einsum("nk,k->n", each - known[0], far) for each in (known, places))
    order = np.argsort(along, kind="stable")
    return np.stack([np.interp(wanted, along[order], column) for column in values[order].T], axis=-1)


def _on_triangles(known: np.ndarray, values: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (n,p) at places (n,2), linear on Delaunay's triangles of the points `known` (m,2) with `values` (m,p), and
    whether a triangle contains the place (n)."""
    corners = np.unique(np.sort(scipy.spatial.Delaunay(known).simplices, axis=1), axis=0)
    table, inside = np.zeros((len(places), values.shape[1])), np.zeros(len(places), bool)
    for a, b, c in corners:
        (x1, y1), (x2, y2), (x, y) = known[b] - known[a], known[c] - known[a], (places - known[a]).T
        area = x1 * y2 - x2 * y1
        if area == 0.0:
            continue
        second, third = (x * y2 - x2 * y) / area, (x1 * y - x * y1) / area
        here = ~inside & (np.minimum(np.minimum(second, third), 1.0 - second - third) >= -ROUNDING)
        weights = np.stack([1.0 - second - third, second, third], axis=1)[here]
        table[here] = einsum("nk,kp->np", weights, values[[a, b, c]])
        inside |= here
    return table, inside
