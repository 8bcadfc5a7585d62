"""Renders the deformed surface with pyvista in a subprocess, so that a crash of the graphics driver ends only this one.

python -m palpate.views.surface.render views.npz pixels.npz
"""

import sys
from typing import Any

import numpy as np

from palpate.views.pictures.style import deformation_colours

SIZE = (900, 520)
CLOSE_SIZE = (900, 640)
FINGER_RADIUS = 6e-3  # [m] of the ball that represents the fingertip
ARROW = 26e-3  # [m] length of the arrow of the largest force, on a surface large enough
ARROW_SHARE = 0.4  # limit of that length, as a fraction of the surface's longest side
MARGIN = 1.06  # margin around the whole surface
HEAD = 1.6e-3  # [m] radius of an arrow's head
LEAST_FORCE = 0.05  # [N] smallest force for the scale of the arrows
NEAR = 0.46  # fraction of the height that a close-up shows
VIEW = (0.2, -0.8, 0.95)  # direction from the surface to the camera; z: normal of the surface, upwards
RIGHT = np.cross((0.0, 0.0, 1.0), VIEW) / np.hypot(*VIEW[:2])  # direction to the right in the pictures


def render(views: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Pictures of all instants, wide (k, h, w, 3), and close-ups of some, close (n, h, w, 3), as RGB bytes; wide_pixel
    (k) and close_pixel (n) [m], the size of their pixels on a plane across the view; and newton [m/N], the length of an
    arrow of 1 N.

    vertices [m] (V,3), triangles (T,3), displacement [m] (k,V,3), values (k,V): colour values of the vertices, most:
    end of the colour scale, tips [m] (k,f,3; not finite: no finger), normals [1] (k,f,3), forces [N] (k,f,3), near (n):
    indices of the close-ups, balls [m] (m,3) and pulls [N] (m,3): positions and forces of fingers that must be in view,
    greatest [N]: force of the longest arrow
    """
    import pyvista

    pyvista.OFF_SCREEN = True
    triangles = views["triangles"]
    faces = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
    most = float(views["most"])
    wide: list[np.ndarray] = []
    close: list[np.ndarray] = []
    pixel: dict[str, list[float]] = {"wide_pixel": [], "close_pixel": []}
    scale = _longest(views["vertices"]) / max(float(views["greatest"]), LEAST_FORCE)
    arrows, balls = views["forces"] * scale, views["balls"]
    heads = balls + views["pulls"] * scale
    shots = list(zip(views["displacement"], views["values"], views["tips"], views["normals"], arrows, strict=True))
    for shape, out, which in ((SIZE, wide, range(len(shots))), (CLOSE_SIZE, close, views["near"].tolist())):
        plotter = pyvista.Plotter(off_screen=True, window_size=list(shape), lighting="none")
        _lights(pyvista, plotter)
        for shot in (shots[i] for i in which):
            plotter.clear_actors()
            _draw_surface(pyvista, plotter, views["vertices"], faces, *shot, most, edges=out is close)
            _camera(plotter, views["vertices"], balls, heads, shot, near=out is close)
            plotter.render()
            out.append(np.asarray(plotter.screenshot(return_img=True))[..., :3])
            size = 2.0 * plotter.camera.parallel_scale / shape[1]
            pixel["close_pixel" if out is close else "wide_pixel"].append(size)
        plotter.close()
    sizes = {name: np.array(values) for name, values in pixel.items()}
    return {"wide": np.array(wide), "close": np.array(close), "newton": np.array(scale), **sizes}


def ball_centres(tips: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Centres [m] (m,3) of the balls that represent the fingertip, at all finite tips [m] (k,3)."""
    balls = tips + FINGER_RADIUS * normals
    return balls[np.isfinite(balls).all(axis=1)]


def _longest(vertices: np.ndarray) -> float:
    """Length of the arrow of the largest force [m]."""
    return min(ARROW, ARROW_SHARE * float(np.ptp(vertices, axis=0).max()))


def _lights(pyvista: Any, plotter: Any) -> None:
    for place, strength in (((-0.6, -0.5, 1.4), 0.62), ((0.9, -1.0, 0.5), 0.42), ((0.0, 1.0, 0.8), 0.2)):
        light = pyvista.Light(position=place, intensity=strength, light_type="scene light")
        light.positional = False
        plotter.add_light(light)


def _draw_surface(
    pyvista: Any, plotter: Any, vertices: np.ndarray, faces: np.ndarray, displacement: np.ndarray, values: np.ndarray,
    tips: np.ndarray, normals: np.ndarray, arrows: np.ndarray, most: float, edges: bool,
) -> None:  # fmt: skip
    mesh = pyvista.PolyData(vertices + displacement, faces)
    mesh["value"] = values
    plotter.set_background("white")
    plotter.add_mesh(
        mesh, scalars="value", cmap=deformation_colours(), clim=(0.0, most), show_scalar_bar=False, smooth_shading=True,
        split_sharp_edges=False, ambient=0.28, diffuse=0.85, specular=0.12, specular_power=20,
        show_edges=edges, edge_color="#7a5a54", line_width=0.4, edge_opacity=0.35,
    )  # fmt: skip
    for tip, normal, arrow in zip(tips, normals, arrows, strict=True):
        if not np.isfinite(tip).all():
            continue
        centre = tip + FINGER_RADIUS * normal
        ball = pyvista.Sphere(radius=FINGER_RADIUS, center=centre, theta_resolution=48, phi_resolution=48)
        plotter.add_mesh(
            ball, color="#7fa8c9", opacity=0.3 if edges else 0.45, smooth_shading=True, ambient=0.3, specular=0.3
        )
        length = float(np.linalg.norm(arrow))
        if length > 0.5e-3:
            head = min(1.0, 5e-3 / length)
            pointer = pyvista.Arrow(
                start=centre, direction=arrow, scale=length, tip_length=head, tip_radius=min(0.25, HEAD / length),
                shaft_radius=min(0.1, 0.55e-3 / length),
            )  # fmt: skip
            plotter.add_mesh(pointer, color="#1f3b57", ambient=0.3)


def _camera(plotter: Any, vertices: np.ndarray, balls: np.ndarray, heads: np.ndarray, shot: tuple, near: bool) -> None:
    """Fill the picture with the whole surface, the fingers and the heads of their arrows, or with a close-up of the
    fingers."""
    direction = np.array(VIEW) / np.linalg.norm(VIEW)
    axes = np.array([RIGHT, np.cross(direction, RIGHT), direction])
    seen, round_it, ahead = vertices @ axes.T, balls @ axes.T, heads @ axes.T
    low = np.concatenate([seen, round_it - FINGER_RADIUS, ahead - HEAD]).min(axis=0)
    high = np.concatenate([seen, round_it + FINGER_RADIUS, ahead + HEAD]).max(axis=0)
    focus = (low + high) / 2 @ axes
    width, height = plotter.window_size
    reach = MARGIN * max(high[1] - low[1], (high[0] - low[0]) * height / width) / 2
    there = np.isfinite(shot[2]).all(axis=1)
    if near and there.any():
        tips, arrows = shot[2][there], shot[4][there]
        focus = (tips + 0.4 * arrows).mean(axis=0)
        ends = np.abs((np.concatenate([tips, tips + arrows]) - focus) @ axes[:2].T).max(axis=0)
        across = 1.2 * max(ends[1], ends[0] * height / width)
        reach = max(NEAR * reach, across if len(tips) > 1 else 0.0)
    plotter.camera.focal_point = tuple(focus)
    plotter.camera.position = tuple(focus + 4.0 * float(np.linalg.norm(high - low)) * direction)
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = float(reach)
    plotter.reset_camera_clipping_range()


def main() -> None:
    source, target = sys.argv[1:3]
    with np.load(source) as views:
        pixels = render(dict(views))
    np.savez(target, **pixels)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
