"""The surface of a mask: volume, distance from the true body, thin parts, holes, islands, borders, closed triangles."""

import numpy as np
import pytest
from segmentations import MASKS, errors, surface_of

from palpate.physics.geometry.pieces import pieces
from palpate.physics.geometry.topology import edge_counts
from palpate.physics.segmentation.image import LabelImage, choose_label
from palpate.physics.segmentation.smoothed import signed_distance
from palpate.physics.segmentation.surface import label_surface

pytest.importorskip("skimage")
MM = 1e-3


def image(mask, spacing=(1.0, 1.0, 1.0)):
    affine = np.column_stack([np.diag(spacing) * MM, np.zeros(3)])
    return LabelImage("a.nii.gz", np.asarray(mask, np.uint8)[None], affine)


def surface(mask, spacing=(1.0, 1.0, 1.0)):
    found = image(mask, spacing)
    return label_surface(found, choose_label(found, 1))


@pytest.mark.parametrize("name", [name for name in MASKS if "ellipsoid" in name])
def test_the_surface_of_an_ellipsoid_is_within_half_a_voxel(name):
    """Its root mean square is 0.04 to 0.07 of the longest side."""
    side = max(MASKS[name][1]) * MM
    mean, rms, most = errors(name)
    assert abs(mean) < 0.02 * side and rms < 0.08 * side and most < 0.5 * side


@pytest.mark.parametrize("name", MASKS)
def test_volume_and_triangles_of_each_mask(name):
    made = surface_of(name)
    assert made.enclosed == pytest.approx(made.volume, rel=0.01)
    assert edge_counts(made.mesh.triangles, len(made.mesh.vertices)) == (0, 0)
    count = pieces(made.mesh.triangles, len(made.mesh.vertices)).max() + 1
    assert count == (3 if name == "islands" else 1)
    texts = {
        "holes": "3 holes in the label 1 filled: 0.273 cm³, 0.273 cm³, 0.267 cm³",
        "cut": "the label 1 reaches the border of the image (left), which cuts it over 10.4 cm²: it is closed by a "
        "plane there, which is not its surface",
    }
    assert " ".join(made.notes) == texts.get(name, "")


def test_random_masks_give_closed_surfaces_with_their_volume():
    """20 masks of smoothed noise, with tunnels, islands, holes, contacts at edges and corners."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(5)
    for seed in range(20):
        noise = gaussian_filter(rng.normal(size=(18, 22, 26)), rng.uniform(0.8, 2.5))
        made = surface(noise > np.quantile(noise, rng.uniform(0.4, 0.8)), rng.uniform(0.5, 3.0, 3))
        assert edge_counts(made.mesh.triangles, len(made.mesh.vertices)) == (0, 0), seed
        assert made.enclosed == pytest.approx(made.volume, rel=0.01), seed


@pytest.mark.parametrize(("voxels", "least", "most"), [(1, 0.6, 1.1), (2, 1.5, 2.1), (3, 2.8, 3.3), (6, 5.7, 6.6)])
def test_a_plate_keeps_its_thickness(voxels, least, most):
    mask = np.zeros((40, 40, 20), bool)
    mask[5:35, 5:35, 7 : 7 + voxels] = True
    points = surface(mask).mesh.vertices / MM
    inner = (np.abs(points[:, :2] - 19.5) < 8.0).all(axis=1)
    assert least < np.ptp(points[inner, 2]) < most


def test_a_bridge_of_one_voxel_joins_two_balls():
    points = surface_of("bridge").mesh.vertices
    middle = np.abs(points[:, 0]) < 2 * MM
    assert 0.6 * MM < np.ptp(points[middle, 1]) < 1.4 * MM


def test_holes_of_other_labels_are_filled_and_a_large_cavity_remains():
    index = np.moveaxis(np.indices((41, 41, 41)), 0, -1) - 20
    away = np.linalg.norm(index, axis=-1)
    voxels = np.where(away < 18, 1, 0)
    voxels[away < 8] = 3
    found = LabelImage("a.nii.gz", voxels.astype(np.uint8)[None], image(voxels).affine, names={3: "tumour"})
    made = label_surface(found, choose_label(found, 1))
    assert made.notes == ("1 hole in the label 1 filled: 2.1 cm³ of label 3 (tumour)",)
    assert made.volume == pytest.approx(4 / 3 * np.pi * (18 * MM) ** 3, rel=0.01)
    hollow = np.where(away < 8, 0, voxels)
    made = surface(hollow)
    assert made.notes[0].startswith("the label 1 has 1 cavity of 2.1 cm³, which remains")
    assert pieces(made.mesh.triangles, len(made.mesh.vertices)).max() == 1
    assert made.enclosed == pytest.approx(made.volume, rel=0.01)


def test_distances_in_blocks_are_those_of_the_whole():
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    rng = np.random.default_rng(7)
    mask = gaussian_filter(rng.normal(size=(70, 66, 130)), 3.0) > 0.05
    spacing, reach = np.array([1.0, 1.5, 0.7]), 6.0
    whole = distance_transform_edt(~mask, sampling=spacing) - distance_transform_edt(mask, sampling=spacing)
    np.testing.assert_allclose(signed_distance(mask, spacing, reach), np.clip(whole, -reach, reach), atol=1e-5)


def test_single_voxels_far_from_the_organ_are_left_out_and_a_very_large_box_is_refused():
    from palpate.physics.errors import MeshError

    large = np.zeros((400, 400, 400), bool)
    large[100:120, 200:230, 51:70] = True
    alone = surface(large[90:130, 190:240, 40:80])
    large[::399, ::399, ::399] = True
    made = surface(large)
    assert made.notes == ("8 parts of the label 1 with less than 1% of the largest, together 0.0007 of its voxels, are "
                          "left out",)  # fmt: skip
    np.testing.assert_allclose(made.mesh.vertices, alone.mesh.vertices + MM * np.array([90, 190, 40]), atol=1e-6)
    large[:] = False
    large[:5, :5, :5] = large[-5:, -5:, -5:] = True
    with pytest.raises(MeshError, match=r"spans 400 x 400 x 400 voxels, .* Resample it to voxels that are 1.2 times"):
        surface(large)
