"""A phantom: magnetic resonance images of a fingertip of known shape, with noise and partial volume, as real files.

The brightness of a voxel is the mean over its volume; noise is Rician, as in magnitude images. The nail is dark, as in
the body. Slices run from the tip to the hand, with the nail up.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.models.scan.stack import Stack
from palpate.physics.fingertip.anatomy import Anatomy

BRIGHTNESS = {"air": 0.0, "skin": 0.45, "tissue": 0.9, "bone": 0.12}
MIDDLE = np.array([0.0, 12e-3, 0.0])  # [m] centre of rotation of the finger
FULL = 4000  # Largest stored value of a pixel


def scan(
    anatomy: Anatomy = Anatomy(),  # noqa: B008 - frozen
    slices: int = 23,
    spacing: tuple[float, float, float] = (1.2e-3, 0.23e-3, 0.23e-3),
    pixels: int = 112,
    noise: float = 0.03,
    shading: float = 0.05,
    start: float = -0.5e-3,
    seed: int = 0,
    roll: float = 0.0,
    tilt: float = 0.0,
    lean: float = 0.0,
) -> Stack:
    """Images of a fingertip.

    spacing  [m] between slices, rows, columns; slices are as thick as their spacing
    pixels   rows and columns; the image is centred on the finger's middle
    noise    [1] standard deviation in each channel, the brightest tissue being 0.9
    shading  [1] fall of the brightness from left to right
    start    [m] middle of the first slice, from the tip
    roll, tilt, lean  [rad] rotations of the finger about its axis, the transverse axis, and the direction to the nail,
                      in this order, around its centre
    """
    parts = (4, 2, 2)
    centre = np.array([0.0, (anatomy.dorsal - anatomy.palmar - anatomy.bulge) / 2])

    def fine(count, step, split, origin):
        return origin + step * ((np.arange(count * split) + 0.5) / split - 0.5)

    low = np.array([[-anatomy.width / 2], [0.0], [-anatomy.palmar - max(anatomy.bulge, 0.0)]])
    high = np.array([[anatomy.width / 2], [np.inf], [anatomy.dorsal]])
    turn = Rotation.from_euler("yxz", [roll, tilt, lean]).as_matrix()
    z = -fine(pixels, spacing[1], parts[1], -(pixels - 1) / 2 * spacing[1]) + centre[1]
    x = fine(pixels, spacing[2], parts[2], -(pixels - 1) / 2 * spacing[2]) + centre[0]
    volume = np.empty((slices, pixels, pixels), dtype=np.float32)
    for k in range(slices):
        y = fine(1, spacing[0], parts[0], start + k * spacing[0])
        points = np.stack(np.meshgrid(x, y, z, indexing="ij")).reshape(3, -1)
        points = turn.T @ (points - MIDDLE[:, None]) + MIDDLE[:, None]
        light = np.full(points.shape[1], BRIGHTNESS["air"])
        inside = np.flatnonzero(((points >= low) & (points <= high)).all(axis=0))
        for name in ("skin", "tissue", "bone"):
            light[inside[anatomy.level(name, points[:, inside].T) < 0]] = BRIGHTNESS[name]
        light = light.reshape(len(x), len(y), len(z)).mean(axis=1)
        volume[k] = light.T.reshape(pixels, parts[1], pixels, parts[2]).mean(axis=(1, 3))
    volume *= 1 + shading * (0.5 - np.linspace(0, 1, pixels))
    random = np.random.default_rng(seed)
    both = random.normal(scale=noise, size=(2, *volume.shape))
    return Stack(np.hypot(volume + both[0], both[1]).astype(np.float32), spacing, "phantom")


def stored(stack: Stack) -> np.ndarray:
    return np.round(np.clip(stack.volume, 0, 1.2) / 1.2 * FULL).astype(np.uint16)


def write_dicom(stack: Stack, folder: str | Path, axes=None) -> Path:
    """An MR series, one file per slice, with names in reverse order.

    axes  [1] (3,3)  directions of columns, rows and slices in the patient's frame, as rows; None: x, y, z
    """
    import pydicom
    from pydicom.dataset import FileDataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, MRImageStorage, generate_uid

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    study, series, frame = generate_uid(), generate_uid(), generate_uid()
    data = stored(stack)
    across, down, on = np.eye(3) if axes is None else np.asarray(axes, float)
    for k, image in enumerate(data):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID = MRImageStorage
        meta.MediaStorageSOPInstanceUID = generate_uid()
        meta.TransferSyntaxUID = ExplicitVRLittleEndian
        name = folder / f"image_{len(data) - k:03d}.dcm"
        dataset = FileDataset(str(name), {}, file_meta=meta, preamble=b"\0" * 128)
        dataset.SOPClassUID, dataset.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
        dataset.StudyInstanceUID, dataset.SeriesInstanceUID, dataset.FrameOfReferenceUID = study, series, frame
        dataset.PatientName, dataset.PatientID, dataset.Modality = "Phantom^Fingertip", "phantom", "MR"
        dataset.StudyDate = dataset.SeriesDate = dataset.ContentDate = "20000101"
        dataset.InstanceNumber = k + 1
        dataset.Rows, dataset.Columns = image.shape
        dataset.PixelSpacing = [f"{s * 1e3:.6g}" for s in stack.spacing[1:]]
        dataset.SliceThickness = f"{stack.spacing[0] * 1e3:.6g}"
        dataset.ImageOrientationPatient = [f"{v:.12f}" for v in (*across, *down)]
        dataset.ImagePositionPatient = [f"{v:.9f}" for v in k * stack.spacing[0] * 1e3 * on]
        dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
        dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 16, 16, 15, 0
        dataset.PixelData = image.tobytes()
        pydicom.dcmwrite(name, dataset, enforce_file_format=True)
    return folder


def write_nifti(stack: Stack, path: str | Path) -> Path:
    """A NIfTI volume (column, row upwards, slice): columns to the left, upwards to the front, slices to the head."""
    import nibabel

    between = [s * 1e3 for s in stack.spacing]
    data = stored(stack)[:, ::-1].transpose(2, 1, 0).astype(np.int16)
    image = nibabel.Nifti1Image(data, np.diag([-between[2], between[1], between[0], 1.0]))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return Path(path)
