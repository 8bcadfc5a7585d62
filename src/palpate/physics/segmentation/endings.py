"""The endings of files of segmentations."""

from pathlib import Path

FORMATS = (".nii", ".nii.gz", ".nrrd", ".mha", ".dcm")


def ending_of(path: str | Path) -> str:
    """The ending of the name of a segmentation; "": it is none."""
    name = Path(path).name.lower()
    return next((each for each in sorted(FORMATS, key=len, reverse=True) if name.endswith(each)), "")


JOIN = "+"
"""Between two labels, `liver+tumour`: the second is inside of the first."""
ON = "/"
"""Between an organ and bone, `gluteus/femur+hip`: the labels of bone are next to the organ, and rigid."""
