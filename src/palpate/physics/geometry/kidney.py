"""The kidney: a closed bicubic surface with published anatomical dimensions.

Length pole to pole 110 mm: computed tomography of 2068 kidneys gave 108.5 +- 12.2 mm on the right and 111.3 +- 12.6 mm
on the left (B. Glodny et al., BMC Urology 9 (2009) 19). Width 60 mm and thickness 42 mm lie in the usual adult range
of 50-70 mm and 30-50 mm; as an ellipsoid these give 145 cm3, and sonography of 665 adults found a median volume of
146 cm3 left, 134 cm3 right (S. A. Emamian et al., Am. J. Roentgenol. 160 (1993) 83-86).

    python -m palpate.physics.geometry.kidney kidney.ply --vertices 3000    writes a mesh of it

Shape: a round body, bent towards its medial side, with a hollow (the hilum) in the middle of that side.
"""

import argparse
from functools import lru_cache

import numpy as np

from palpate.compiler.exact import cos, exp, product, sin
from palpate.physics.geometry.mesh import write_ply
from palpate.physics.geometry.nurbs import NurbsPatch
from palpate.physics.geometry.nurbs_fit import interpolate
from palpate.physics.geometry.tessellate import tessellate

LENGTH, WIDTH, THICKNESS = 0.110, 0.060, 0.042

BEND = 0.20  # Offset of the middle from the ends, in half lengths; above 25 % of the width the medial side is concave
TAPER = 0.05  # Relative excess width of the upper pole over the middle, and deficit of the lower pole
HOLLOW, HOLLOW_LENGTH, HOLLOW_HEIGHT = 0.18, 0.30, 0.24
"""Depth, and half extents along length and thickness, of the hilum, in half lengths."""
AROUND, ALONG = 32, 33  # Size of the grid of interpolation points


def shape(direction: np.ndarray) -> np.ndarray:
    """The smooth shape to interpolate, in half lengths (...,3), for unit directions (...,3): x from the lower to the
    upper pole, y from the hilum to the lateral border, z from back to front."""
    x, y, z = np.moveaxis(direction, -1, 0)
    fuller = 1.0 + 0.25 * x**2  # blunter poles than those of an ellipsoid
    wide = 0.47 * (1.0 + TAPER * x) * fuller
    high = 0.37 * (1.0 + TAPER * x) * fuller
    along = x * (1.0 + 0.06 * (1.0 - x**2))
    medial = (1.0 - y) / 2.0
    hollow = HOLLOW * medial * medial * medial
    hollow = hollow * exp(-((along / HOLLOW_LENGTH) ** 2) - (high * z / HOLLOW_HEIGHT) ** 2)
    return np.stack([along, wide * y - BEND * along**2 + hollow, high * z], axis=-1)


@lru_cache(maxsize=4)
def kidney(length: float = LENGTH, width: float = WIDTH, thickness: float = THICKNESS) -> NurbsPatch:
    """The closed kidney surface, centred on its bounding box.

    length, width, thickness  [m]  extent along x (pole to pole), y (hilum to lateral border), z (back to front)

    u runs round the long axis and wraps, with continuous second derivatives; v runs from the lower to the upper pole.
    All dS/dv at a pole are prescribed in one plane, so that the pole has a tangent plane.

    ValueError: a dimension that is not positive.
    """
    size = np.array([length, width, thickness], dtype=float)
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise ValueError(f"kidney: found {length} x {width} x {thickness} m, expected three positive lengths")
    phi = np.arange(AROUND) / AROUND * 2 * np.pi
    theta = np.linspace(0.0, np.pi, ALONG)
    around = np.stack([np.zeros(AROUND), cos(phi), sin(phi)], axis=-1)
    axis = np.array([1.0, 0.0, 0.0])
    direction = around[:, None] * sin(theta)[:, None] - axis * cos(theta)[:, None]
    points = shape(direction)
    points[:, 0], points[:, -1] = shape(-axis), shape(axis)
    slopes = [_slope(pole, around) * np.pi * sign for pole, sign in ((-axis, 1.0), (axis, -1.0))]
    fitted = interpolate(points, (slopes[0], slopes[1]))
    grid = np.linspace(0.0, 1.0, 241)
    box = fitted(grid[:, None], grid).reshape(-1, 3)  # its extent is exact within 1e-4 of the size
    low, high = box.min(axis=0), box.max(axis=0)
    scale = size / (high - low)
    return fitted.move(np.diag(scale), -scale * (low + high) / 2)


def _slope(pole: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Derivative of the shape per radian away from a pole, in each direction; linear in it, so that all are coplanar.
    Richardson extrapolation of central differences."""
    h = 1e-4

    def ahead(tangent: np.ndarray, h: float) -> np.ndarray:
        moved = (shape(pole * cos(s * h) + tangent * sin(s * h)) for s in (1.0, -1.0))
        return np.subtract(*moved) / (2 * h)

    basis = np.array([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    columns = np.array([(4 * ahead(t, h) - ahead(t, 2 * h)) / 3 for t in basis])
    return product(around[:, 1:], columns)


def main() -> None:
    """Write a mesh of the kidney to a PLY file."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("file")
    parser.add_argument("--vertices", type=int, default=3000)
    for name, default in (("length", LENGTH), ("width", WIDTH), ("thickness", THICKNESS)):
        parser.add_argument(f"--{name}", type=float, default=default, help="[m]")
    given = parser.parse_args()
    try:
        write_ply(given.file, tessellate(kidney(given.length, given.width, given.thickness), given.vertices))
    except (ValueError, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
