"""From magnetic resonance images of a finger to a fingertip that beams can fill.

    stack = read("dicom_folder")            # or a NIfTI file
    tip = rebuild(segment(stack))           # palpate.physics.fingertip.surfaces.FingertipSurfaces
    tip.save("finger.npz")

Needs the extra `scan`: pip install palpate[scan].
"""

from palpate.models.scan.outline import Outlines, segment
from palpate.models.scan.read import read
from palpate.models.scan.rebuild import rebuild
from palpate.models.scan.stack import ScanError, Stack

__all__ = ["Outlines", "ScanError", "Stack", "read", "rebuild", "segment"]
