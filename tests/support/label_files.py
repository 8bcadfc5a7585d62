"""Files of segmentations, written by other libraries: NIfTI, NRRD, MetaImage, DICOM, with a known left and right."""

import io
from itertools import permutations, product

import numpy as np

BALLS = np.array([[0, 0, 0, 12.0], [14, 0, 0, 7], [0, 13, 0, 5], [0, 0, 13, 4]])
"""[mm] Centre and radius of balls: the second is at the right of the body, the third in front, the last at the head."""
CENTRE = np.array([30.0, -50.0, 120.0])  # [mm] of the first
TO_LPS = np.array([-1.0, -1.0, 1.0])


def away(points):
    """Distance [mm] (...) of points (...,3) from the surface of the balls, negative inside; exact outside."""
    offset = np.linalg.norm(points[..., None, :] - CENTRE - BALLS[:, :3], axis=-1)
    return (offset - BALLS[:, 3]).min(axis=-1)


def orientations():
    """All 48 ways in which the axes of an image can lie along those of the body: (3,3), columns of an affine."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        yield np.eye(3)[:, order] * signs


def labels(turn, spacing=(1.0, 1.5, 2.0), level=away):
    """Voxels (i,j,k) with 2 inside of `level` < 0 and 5 in a corner, and their affine (4,4) [mm], RAS."""
    axes = turn * np.asarray(spacing)
    half = np.abs(np.linalg.inv(axes) @ np.full(3, 26.0)).astype(int)
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes, CENTRE - axes @ half
    index = np.moveaxis(np.indices(2 * half + 1), 0, -1)
    voxels = (level(index @ axes.T + affine[:3, 3]) < 0.0).astype(np.uint8) * 2
    voxels[:2, :3, :1] = 5
    return voxels, affine


def write_nifti(path, voxels, affine):
    import nibabel

    nibabel.save(nibabel.Nifti1Image(voxels, affine), path)


def write_nrrd(path, voxels, affine, space="left-posterior-superior", **more):
    import nrrd

    turn = np.array([-1.0 if "left" in space else 1.0, -1.0 if "posterior" in space else 1.0, 1.0])
    nrrd.write(str(path), voxels, {
        "space": space, "space directions": (turn[:, None] * affine[:3, :3]).T, "space origin": turn * affine[:3, 3],
        "encoding": "gzip", **more,
    })  # fmt: skip


def write_itk(path, voxels, affine, packed=True):
    """By SimpleITK, in the format of the ending."""
    import SimpleITK

    image = SimpleITK.GetImageFromArray(np.ascontiguousarray(voxels.T))
    sides = np.linalg.norm(affine[:3, :3], axis=0)
    image.SetSpacing(sides.tolist())
    image.SetDirection((TO_LPS[:, None] * affine[:3, :3] / sides).ravel().tolist())
    image.SetOrigin((TO_LPS * affine[:3, 3]).tolist())
    SimpleITK.WriteImage(image, str(path), packed)


def write_dicom(path, voxels, affine, names=None, kind="BINARY"):
    """A segmentation without its empty frames; the values of `voxels` are the numbers of the segments."""
    import pydicom
    from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    sides = np.linalg.norm(affine[:3, :3], axis=0)
    axes = TO_LPS[:, None] * affine[:3, :3] / sides
    meta = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.66.4"
    meta.MediaStorageSOPInstanceUID = generate_uid()
    data = FileDataset(None, {}, file_meta=meta, preamble=bytes(128))
    data.SOPClassUID, data.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    data.Modality, data.SegmentationType = "SEG", kind
    data.Rows, data.Columns = voxels.shape[1], voxels.shape[0]
    data.SamplesPerPixel, data.PhotometricInterpretation, data.PixelRepresentation = 1, "MONOCHROME2", 0
    data.BitsAllocated = data.BitsStored = 1 if kind == "BINARY" else 8
    data.HighBit = data.BitsStored - 1
    data.MaximumFractionalValue = 255
    shared, measures, plane = Dataset(), Dataset(), Dataset()
    measures.PixelSpacing, measures.SliceThickness = [float(sides[1]), float(sides[0])], float(sides[2])
    plane.ImageOrientationPatient = [*axes[:, 0].tolist(), *axes[:, 1].tolist()]
    shared.PixelMeasuresSequence, shared.PlaneOrientationSequence = [measures], [plane]
    data.SharedFunctionalGroupsSequence = [shared]
    data.SegmentSequence, frames, groups = [], [], []
    for number in map(int, np.unique(voxels[voxels > 0])):
        segment = Dataset()
        segment.SegmentNumber, segment.SegmentLabel = number, (names or {}).get(number, f"part {number}")
        data.SegmentSequence.append(segment)
        for k in np.flatnonzero((voxels == number).any(axis=(0, 1))):
            group, where, which = Dataset(), Dataset(), Dataset()
            where.ImagePositionPatient = (TO_LPS * (affine[:3, 2] * k + affine[:3, 3])).tolist()
            which.ReferencedSegmentNumber = number
            group.PlanePositionSequence, group.SegmentIdentificationSequence = [where], [which]
            groups.append(group)
            frames.append((voxels[:, :, k] == number).T)
    data.PerFrameFunctionalGroupsSequence, data.NumberOfFrames = groups, len(frames)
    stack = np.array(frames, np.uint8)
    content = pydicom.pixels.pack_bits(stack) if kind == "BINARY" else (200 * stack).tobytes()
    data.PixelData = content + bytes(len(content) % 2)
    stream = io.BytesIO()
    data.save_as(stream, enforce_file_format=True)
    path.write_bytes(stream.getvalue())
