"""Images of a finger as files, as a scanner's program exports them."""

from pathlib import Path

from skimage.io import imsave

from palpate.models.scan import phantom


def write_images(stack, folder: Path, kind: str = "png") -> Path:
    """Numbered 16-bit images, .png or .tif."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, image in enumerate(phantom.stored(stack)):
        imsave(folder / f"slice_{k:03d}.{kind}", image, check_contrast=False)
    return folder
