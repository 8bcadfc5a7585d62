"""A displacement field sent as few numbers."""

import numpy as np
from pytest import approx

from palpate.nodes.base.surface import surface_mesh
from palpate.physics.geometry.graded import fill_field, ranges, spread_over

POINTS = surface_mesh("kidney", 3000).vertices
TOP = POINTS[POINTS[:, 2].argmax()]


def sent(near=10e-3, foot=TOP):
    return np.flatnonzero(np.linalg.norm(POINTS - foot, axis=1) <= ranges(POINTS, near))


def test_all_vertices_near_the_contact_are_sent_and_few_others():
    nodes = sent()
    close = np.flatnonzero(np.linalg.norm(POINTS - TOP, axis=1) <= 10e-3)
    assert set(close) <= set(nodes)
    assert len(close) > 40 and len(nodes) < 0.1 * len(POINTS)


def test_the_sent_vertices_cover_the_body_more_finely_near_the_contact():
    nodes = sent()
    gaps = np.linalg.norm(POINTS[:, None] - POINTS[nodes][None], axis=2).min(axis=1)
    assert (gaps <= 0.35 * np.maximum(np.linalg.norm(POINTS - TOP, axis=1) - 10e-3, 0.0) + 3e-3).all()


def test_a_tilted_and_lowered_body_is_interpolated():
    rigid = np.cross([0.02, -0.01, 0.03], POINTS) + [1e-3, 0.0, -2e-3]
    nodes = sent()
    shown = fill_field(POINTS, nodes, rigid[nodes])
    assert (shown[nodes] == rigid[nodes]).all()
    assert np.abs(shown - rigid).max() < 0.005 * np.abs(rigid).max()


def test_the_field_of_a_point_load_below_the_surface_is_interpolated():
    depth = TOP - [0.0, 0.0, 6e-3]
    field = 1.0 / np.linalg.norm(POINTS - depth, axis=1)[:, None]
    nodes = sent()
    assert np.abs(fill_field(POINTS, nodes, field[nodes]) - field).max() < 0.015 * field.max()


def test_few_vertices_are_used_unchanged():
    one = fill_field(POINTS, np.array([5]), np.ones((1, 3)))
    assert one.sum() == approx(3.0) and (one[5] == 1.0).all()


def test_a_receiver_distinguishes_a_whole_surface_from_an_indentation():
    assert spread_over(POINTS, sent())
    assert not spread_over(POINTS, np.flatnonzero(np.linalg.norm(POINTS - TOP, axis=1) <= 40e-3))
    assert not spread_over(POINTS, np.arange(len(POINTS)))  # no vertices remain to be interpolated
