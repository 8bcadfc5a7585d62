"""The proxy (god object): the foot point of a tool inside a body, on the side where the tool entered.

When a tool is more than halfway through a thin body, the nearest point of the surface jumps to the other side. The
proxy remains on the side of entry: C. B. Zilles, J. K. Salisbury, IROS 1995; D. C. Ruspini, K. Kolarov, O. Khatib, The
haptic display of complex graphical environments, SIGGRAPH 1997.

While the tool is outside, the foot is that of `closest` or `mesh_closest`. After the tool has entered from outside,

* the foot is the nearest point if its normal is not reversed and, deep inside, its distance from the last foot is
  explained by the motion of the tool along the surface;
* else it is the local minimum of the distance next to the last foot, under the same conditions;
* else the foot does not move, and the gap is measured along its normal.

This ends when the tool is outside as seen from the side of entry, or far beyond the other side. The gap never changes
faster than the tool moves; the old foot remains until the gap equals that of the new foot. A tool that starts inside,
or jumps, has no side of entry: its foot is the nearest point. Past the border of a sheet the gap is the distance.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.geometry.bvh import ORIGIN
from palpate.physics.geometry.closest import FAR, track
from palpate.physics.geometry.mesh_closest import _descend, _on_triangle, track_mesh
from palpate.physics.geometry.newton import newton
from palpate.physics.geometry.nurbs import normal_of
from palpate.physics.geometry.pseudonormal import normal_at, signed_distance

JUMP = 6e-3  # [m] Motion in a step above which the tool has no side of entry: 6 m/s at 1 kHz, 3 m/s at 500 Hz
TURNED = -0.3
"""[1] Cosine between normals below which a foot is on the other side; a little below 0, for rims at right angles."""
OUTSIDE = -0.5  # [1] The same for the direction from the nearest point to a tool that is outside
AMPLIFIED = 4.0  # [1] Limit of the foot's motion over the tool's, reached in a ball at a depth of 75 % of its radius
SHALLOW = 0.25  # [1] Depth over the smallest width of the body up to which the motion of the foot is not limited
DEEPER, SIMILAR = 1.5, 0.9
"""[1] Beyond this multiple of that depth, the normal is compared with its value there: smallest cosine between them."""
LEAP, ALONG = 1.5e-3, 1.5
"""[m], [1] Limit of the foot's motion in a step deep inside, where a jump would change the force. If samples were lost
and the tool has moved farther along the surface, the limit is this multiple of its motion."""
BORDER_EXCESS = 1e-6  # [1] Relative excess of the distance over the gap from which the tool is past a border
ROUNDING = 1e-7  # [m] Motion of a foot that counts as none
FAR_BEYOND = 20e-3  # [m] Distance from the body at which the side of entry is forgotten
STARTED, INSIDE, GAP, DEEP, TOOL, FOOT, NORMAL, PLACE, ENTRY, OPEN = 0, 1, 2, 3, 4, 7, 10, 13, 16, 19
"""Entries of the memory: whether a last step exists, whether the tool is inside, last gap [m], depth [m] from which the
motion of the foot is limited; tool [m], foot [m], normal [1] (3 each); parameters, or triangle and weights (3); the
normal at `DEEPER` times that depth [1] (3); whether the surface has a border."""


def memory(points: np.ndarray, border: bool = False) -> np.ndarray:
    """Memory of a tool before its first step, for a surface through points [m] (...,3), with or without a border."""
    state = np.zeros(20)
    state[OPEN] = float(border)
    state[DEEP] = SHALLOW * float(np.ptp(points.reshape(-1, 3), axis=0).min())
    return state


@kernel
def _moved(p, memory):
    """Motion of the tool since the last step [m]; inf at the first step and after a jump."""
    square = 0.0
    for k in range(3):
        square += (p[k] - memory[TOOL + k]) ** 2
    return np.sqrt(square) if memory[STARTED] == 1.0 and square <= JUMP * JUMP else np.inf


@kernel
def _at_border(p, along, foot):
    """Past the border of a sheet (the distance exceeds its part `along` the normal), the gap is the distance."""
    a, b, c = p[0] - foot[0], p[1] - foot[1], p[2] - foot[2]
    distance = np.sqrt(a * a + b * b + c * c)
    if distance > abs(along) * (1.0 + BORDER_EXCESS) + ROUNDING:
        foot[3], foot[4], foot[5], foot[8] = a / distance, b / distance, c / distance, distance


@kernel
def _turned(foot, memory):
    along = foot[3] * memory[NORMAL] + foot[4] * memory[NORMAL + 1] + foot[5] * memory[NORMAL + 2]
    return along < TURNED


@kernel
def _outside(p, foot, memory):
    """Whether the tool is outside as seen from the side of entry, or far away."""
    if not foot[8] > 0.0 or foot[8] > FAR_BEYOND:
        return foot[8] > 0.0
    along = square = 0.0
    for k in range(3):
        along += (p[k] - foot[k]) * memory[NORMAL + k]
        square += (p[k] - foot[k]) ** 2
    return along >= OUTSIDE * np.sqrt(square)


@kernel
def _plausible(p, foot, memory):
    """Whether a new foot continues the last one: same side, and a motion explained by that of the tool."""
    if _turned(foot, memory):
        return False
    if -memory[GAP] <= memory[DEEP] and -foot[8] <= memory[DEEP]:
        return True
    depth = moved = side = cosine = 0.0
    for k in range(3):
        cosine += foot[3 + k] * memory[ENTRY + k]
        depth += (p[k] - memory[FOOT + k]) * memory[NORMAL + k]
    for k in range(3):
        moved += (foot[k] - memory[FOOT + k]) ** 2
        side += (p[k] - memory[FOOT + k] - depth * memory[NORMAL + k]) ** 2
    if -memory[GAP] > DEEPER * memory[DEEP] and cosine < SIMILAR:
        return False
    side = np.sqrt(side)
    return np.sqrt(moved) <= min(AMPLIFIED * side, max(LEAP, ALONG * side)) + ROUNDING


@kernel
def _regular(p, foot, moved, memory):
    """Whether the nearest point is the foot; updates whether the tool is inside."""
    if moved == np.inf:
        memory[INSIDE] = 0.0
        return True
    if memory[INSIDE] == 0.0:
        turned = _turned(foot, memory)
        if memory[GAP] > 0.0 and (foot[8] <= 0.0 or (turned and memory[GAP] <= moved)):
            memory[INSIDE] = 1.0
            return not turned
        return True
    if _outside(p, foot, memory):
        memory[INSIDE] = 0.0
        return True
    return foot[8] <= 0.0 and _plausible(p, foot, memory)


@kernel
def _stay(p, memory, foot):
    """Copy the last foot into `foot`, with the gap along its normal."""
    foot[8] = 0.0
    for k in range(3):
        foot[k], foot[3 + k] = memory[FOOT + k], memory[NORMAL + k]
        foot[8] += (p[k] - foot[k]) * foot[3 + k]


@kernel
def _end(p, moved, inside, foot, memory):
    """Limit the change of the gap to the tool's motion and store the step; returns whether the last foot remains.

    inside  whether the tool was inside in the last step
    """
    stays = False
    if moved < np.inf:
        gap = min(max(foot[8], memory[GAP] - moved), memory[GAP] + moved)
        stays = inside and memory[INSIDE] == 0.0 and foot[8] > gap + ROUNDING
        if stays:
            memory[INSIDE] = 1.0
            _stay(p, memory, foot)
        foot[8] = gap
    memory[STARTED], memory[GAP] = 1.0, foot[8]
    for k in range(3):
        memory[TOOL + k], memory[FOOT + k], memory[NORMAL + k] = p[k], foot[k], foot[3 + k]
        if -foot[8] <= DEEPER * memory[DEEP]:
            memory[ENTRY + k] = foot[3 + k]
    return stays


@kernel
def _limited(x):
    return min(max(x, -FAR), FAR)


@kernel
def follow(data, layout, seeds, index, point, hysteresis, state, work, d, foot, memory):
    """The foot of a tool at `point` [m] (3) on a NURBS surface: arguments and result as of `track`."""
    p = (_limited(point[0]), _limited(point[1]), _limited(point[2]))
    moved, inside = _moved(p, memory), memory[INSIDE] == 1.0
    track(data, layout, seeds, index, p[0], p[1], p[2], hysteresis, state, work, d, foot)
    if memory[OPEN] == 1.0:
        along = 0.0
        for k in range(3):
            along += (p[k] - foot[k]) * foot[3 + k]
        _at_border(p, along, foot)
    if not _regular(p, foot, moved, memory):
        nearest = foot.copy()
        u, v, _ = newton(data, layout, p[0], p[1], p[2], memory[PLACE], memory[PLACE + 1], work, d[0])
        n0, n1, n2 = normal_of(data, layout, u, v, d[0])
        foot[0], foot[1], foot[2] = d[0, 0, 0], d[0, 0, 1], d[0, 0, 2]
        foot[3], foot[4], foot[5], foot[6], foot[7] = n0, n1, n2, u, v
        foot[8] = (p[0] - foot[0]) * n0 + (p[1] - foot[1]) * n1 + (p[2] - foot[2]) * n2
        if not _plausible(p, foot, memory):
            _stay(p, memory, foot)
            foot[6], foot[7] = memory[PLACE], memory[PLACE + 1]
        if foot[8] > 0.0:
            memory[INSIDE] = 0.0
            for k in range(len(foot)):
                foot[k] = nearest[k]
        state[0], state[1] = foot[6], foot[7]
    if _end(p, moved, inside, foot, memory):
        foot[6], foot[7] = memory[PLACE], memory[PLACE + 1]
    memory[PLACE], memory[PLACE + 1] = foot[6], foot[7]


@kernel
def follow_mesh(points, cells, discs, star_at, star, point, hysteresis, work, foot, memory):
    """The foot of a tool at `point` [m] (3) on a triangle mesh: arguments and result as of `track_mesh`."""
    p = (_limited(point[0]), _limited(point[1]), _limited(point[2]))
    moved, inside = _moved(p, memory), memory[INSIDE] == 1.0
    track_mesh(points, cells, discs, star_at, star, p[0], p[1], p[2], hysteresis, work, foot)
    if memory[OPEN] == 1.0:
        _, v, w, place = _on_triangle(points, cells, work[0], p[0], p[1], p[2])
        _at_border(p, signed_distance(points, cells, star_at, star, work[0], v, w, place, p[0], p[1], p[2], foot), foot)
    if not _regular(p, foot, moved, memory):
        nearest, local = foot.copy(), work[0]
        t, _ = _descend(points, cells, star_at, star, p[0], p[1], p[2], int(memory[PLACE]))
        _, v, w, place = _on_triangle(points, cells, t, p[0], p[1], p[2])
        foot[8] = signed_distance(points, cells, star_at, star, t, v, w, place, p[0], p[1], p[2], foot)
        normal_at(points, cells, t, v, w, foot)
        work[0], foot[6], foot[7] = t, v, w
        if foot[8] > 0.0 or not _plausible(p, foot, memory):
            _stay(p, memory, foot)
            work[0], foot[6], foot[7] = int(memory[PLACE]), memory[PLACE + 1], memory[PLACE + 2]
        if foot[8] > 0.0:
            memory[INSIDE], work[0] = 0.0, local
            for k in range(len(foot)):
                foot[k] = nearest[k]
    if _end(p, moved, inside, foot, memory):
        work[0], foot[6], foot[7] = int(memory[PLACE]), memory[PLACE + 1], memory[PLACE + 2]
    foot[9] = cells[work[0], ORIGIN]
    memory[PLACE], memory[PLACE + 1], memory[PLACE + 2] = work[0], foot[6], foot[7]
