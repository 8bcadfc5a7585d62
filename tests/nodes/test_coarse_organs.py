"""Presses on coarse convex organs: no bridge, and the force of the fine organ within the error of the triangles."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import palpate
from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.topology import outward

HALF = np.array([45e-3, 35e-3, 25e-3])  # [m] half axes
TOP, DEPTH = 0.105, 3e-3  # [m] of the ellipsoid, whose long axis is vertical; how deep the hand is led


def ellipsoid(rows, columns):
    """Of rows of latitude."""
    down, turn = np.meshgrid(np.linspace(0.0, np.pi, rows + 1)[1:-1], np.arange(columns) * 2 * np.pi / columns,
                             indexing="ij")  # fmt: skip
    points = np.stack([np.sin(down) * np.cos(turn), np.sin(down) * np.sin(turn), np.cos(down)], axis=-1)
    points = np.concatenate([points.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]) * HALF
    return Mesh(points, outward(points, ConvexHull(points).simplices.astype(np.int32)))


def press(file, aside, depth):
    """The force [N] of a press at this distance from the long axis, and the notes."""
    top = float(TOP - HALF[0] + HALF[0] * np.sqrt(1.0 - (aside / HALF[2]) ** 2))
    surface = {"surface": str(file), "position": [0.0, 0.0, TOP - float(HALF[0])], "rotation": [0.0, -np.pi / 2, 0.0]}
    hand = {"begin": [-aside, 0.0, top + 8e-3], "path": [{"to": [-aside, 0.0, top - float(depth)], "time": 0.3}]}
    sets = {f"scene.{name}.{key}": value for name, given in (("surface", surface), ("hand", hand))
            for key, value in given.items()}  # fmt: skip
    run = palpate.run("kidney", record=None, duration=0.5, collision="collision.Mesh", sets=sets)
    return run.contact.force[-1], run.notes


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
def test_a_coarse_ellipsoid_is_pressed_like_the_fine_one_without_bridges(tmp_path):
    """One with long triangles, which are thin at its poles, got bridges over ripples of its refined surface."""
    fine, coarse = ellipsoid(100, 200), ellipsoid(6, 63)
    for name, mesh in (("fine", fine), ("coarse", coarse)):
        write_ply(tmp_path / f"{name}.ply", mesh)
    error = np.abs(MeshClosestPoint(coarse).find_along(fine.vertices)[3]).max()
    assert 1e-3 < error < 2e-3  # [m]
    for aside in (0.0, 10e-3):
        force, notes = press(tmp_path / "coarse.ply", aside, DEPTH)
        assert not any("bridged" in note for note in notes)
        low, high = (press(tmp_path / "fine.ply", aside, DEPTH + off)[0] for off in (-error, error))
        assert 0.4 < low < force < high < 1.1
