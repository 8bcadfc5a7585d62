"""Images of a finger in a file without its orientation."""

from functools import cache
from pathlib import Path

import nibabel
import phantom_finger as phantom


@cache
def coarse():
    """The fewest images and pixels that distinguish all sides of a finger, for tests that only read."""
    return phantom.scan(slices=9, pixels=37, spacing=(3e-3, 0.7e-3, 0.7e-3))


def write_images(stack, path: Path) -> Path:
    """A NIfTI file without qform and sform."""
    data = phantom.stored(stack)[:, ::-1].transpose(2, 1, 0)  # its rows grow upwards
    image = nibabel.Nifti1Image(data, None)
    image.header.set_zooms([1e3 * size for size in stack.spacing[::-1]])
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path
