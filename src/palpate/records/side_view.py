"""A picture of tissue and fingers from the side, x to the right and z up, with numpy only."""

from collections.abc import Sequence

import numpy as np

SIZE = 240, 320  # pixels, down and across
COLUMN = 8  # pixels; the highest vertex in each column is drawn
MARGIN = 0.01  # [m] drawn height above the start of the hands
SPAN = 0.08  # [m] least width of the picture
NEAR = 5e-3  # [m] distance from a finger along y of the drawn slice of tissue
RADIUS = 6e-3  # [m] of the drawn finger
PER_NEWTON = 6e-3  # [m] of the bar that shows the force
PAPER, TISSUE, FINGER, FORCE = (255, 255, 255), (222, 150, 140), (90, 110, 160), (200, 30, 30)


def side_view(
    shapes: Sequence[np.ndarray], fingers: Sequence[tuple[Sequence[float], Sequence[float]]],
    begins: Sequence[Sequence[float]],
) -> np.ndarray:  # fmt: skip
    """(240,320,3) uint8.

    shapes   (n,3) [m] vertices of each deformed surface; the slice near the fingers is filled below its upper side
    fingers  position [m] (3) of the bone edge and force [N] (3) of each finger
    begins   [m] (3) start of each hand: the picture is centred below them
    """
    picture = np.full((*SIZE, 3), PAPER, np.uint8)
    middle = np.mean(begins, axis=0)
    span = max(SPAN, float(np.ptp(np.array(begins)[:, 0])) + 2.0 * SPAN / 3.0)
    scale = SIZE[1] / span  # pixels per metre
    x = middle[0] + (np.arange(SIZE[1]) + 0.5 - 0.5 * SIZE[1]) / scale
    z = middle[2] + MARGIN - (np.arange(SIZE[0]) + 0.5) / scale
    for vertices in shapes:
        close = np.min([np.abs(vertices[:, 1] - position[1]) for position, _ in fingers], axis=0) < NEAR
        columns = np.floor((vertices[close, 0] - x[0]) * scale / COLUMN).astype(int)
        inside = (columns >= 0) & (columns < SIZE[1] // COLUMN)
        highest = np.full(SIZE[1] // COLUMN, -np.inf)
        np.maximum.at(highest, columns[inside], vertices[close, 2][inside])
        known = np.flatnonzero(np.isfinite(highest))
        if len(known):
            centres = COLUMN * (known + 0.5)
            top = np.interp(np.arange(SIZE[1]), centres, highest[known], left=-np.inf, right=-np.inf)
            picture[z[:, None] <= top] = TISSUE
    for position, force in fingers:
        across, up = x - position[0], z[:, None] - position[2] - RADIUS
        picture[across**2 + up**2 <= RADIUS**2] = FINGER
        length = PER_NEWTON * float(np.linalg.norm(force))
        picture[(np.abs(across) < 1e-3) & (up > 0.0) & (up < length)] = FORCE
    return picture
