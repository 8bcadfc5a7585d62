"""Images of a finger as files, as a scanner's program exports them."""

from functools import cache
from pathlib import Path

import phantom_finger as phantom
from skimage.io import imsave


@cache
def coarse():
    """As few images of as few pixels as tell each side of a finger from every other: for tests that only read."""
    return phantom.scan(slices=9, pixels=37, spacing=(3e-3, 0.7e-3, 0.7e-3))


def write_images(stack, folder: Path, kind: str = "png") -> Path:
    """Numbered 16-bit images, .png or .tif."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, image in enumerate(phantom.stored(stack)):
        imsave(folder / f"slice_{k:03d}.{kind}", image, check_contrast=False)
    return folder
