"""Images of a finger whose file does not say how the finger lay."""

from functools import cache
from pathlib import Path

import nibabel
import phantom_finger as phantom


@cache
def coarse():
    """As few images of as few pixels as tell each side of a finger from every other: for tests that only read."""
    return phantom.scan(slices=9, pixels=37, spacing=(3e-3, 0.7e-3, 0.7e-3))


def write_images(stack, path: Path) -> Path:
    """A NIfTI file without qform and sform."""
    data = phantom.stored(stack)[:, ::-1].transpose(2, 1, 0)  # its rows grow upwards
    image = nibabel.Nifti1Image(data, None)
    image.header.set_zooms([1e3 * size for size in stack.spacing[::-1]])
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path
