"""Renders the deformed surface with pyvista in a subprocess, so that a crash of the graphics driver ends only this one.

python -m palpate.views.surface.render views.npz pixels.npz

One scene is moved on from view to view. Two pixels are drawn for each one that a picture shows, in place of
multisampling, which costs five times as much in software. Nine views of the kidney take 2.2 s of processor time, 55 %
of that of a new scene with multisampling for each size; the same scene in bare VTK takes 1.0 s. The difference is the
import of pyvista's plotter, which always imports matplotlib.pyplot.
"""

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.registry import collection_suspended

SIZE = (1080, 624)
CLOSE_SIZE = (1080, 768)
FINGER_RADIUS = 6e-3  # [m] of the ball that represents the fingertip
ARROW = 26e-3  # [m] length of the arrow of the largest force, on a surface large enough
ARROW_SHARE = 0.4  # limit of that length, as a fraction of the surface's longest side
MARGIN = 1.06  # margin around the whole surface
HEAD = 1.6e-3  # [m] radius of an arrow's head
LEAST_FORCE = 0.05  # [N] smallest force for the scale of the arrows
NEAR = 0.46  # fraction of the height that a close-up shows
VIEW = (0.2, -0.8, 0.95)  # direction from the surface to the camera; z: normal of the surface, upwards
RIGHT = np.cross((0.0, 0.0, 1.0), VIEW) / np.hypot(*VIEW[:2])  # direction to the right in the pictures
LIGHTS = (((-0.6, -0.5, 1.4), 0.62), ((0.9, -1.0, 0.5), 0.42), ((0.0, 1.0, 0.8), 0.2))
"""Direction towards each light, and its intensity [1]."""
EDGES = "#7a5a54"  # colour of the triangles' edges
SHORTEST = 0.5e-3  # [m] shorter arrows are not drawn


def render(views: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Pictures of all instants, wide (k, h, w, 3), and close-ups of some, close (n, h, w, 3), as RGB bytes; wide_pixel
    (k) and close_pixel (n) [m], the size of their pixels on a plane across the view; and newton [m/N], the length of an
    arrow of 1 N.

    vertices [m] (V,3), triangles (T,3), displacement [m] (k,V,3), values (k,V): colour values of the vertices, most:
    end of the colour scale, tips [m] (k,f,3; not finite: no finger), normals [1] (k,f,3), forces [N] (k,f,3), near (n):
    indices of the close-ups, colours (c,4) of the scale as RGBA bytes, balls [m] (m,3) and pulls [N] (m,3): positions
    and forces of fingers that must be in view, greatest [N]: force of the longest arrow
    """
    scale = _longest(views["vertices"]) / max(float(views["greatest"]), LEAST_FORCE)
    arrows, balls = views["forces"] * scale, views["balls"]
    heads = balls + views["pulls"] * scale
    shots = list(zip(views["displacement"], views["values"], views["tips"], views["normals"], arrows, strict=True))
    scene = Scene(views["vertices"], views["triangles"], float(views["most"]), views["colours"], views["tips"].shape[1])
    wide: list[np.ndarray] = []
    close: list[np.ndarray] = []
    pixel: dict[str, list[float]] = {"wide_pixel": [], "close_pixel": []}
    for size, out, which in ((SIZE, wide, range(len(shots))), (CLOSE_SIZE, close, views["near"].tolist())):
        near = out is close
        for shot in (shots[i] for i in which):
            camera = place_camera(size, views["vertices"], balls, heads, shot, near)
            scene.show_surface(views["vertices"] + shot[0], shot[1], edges=near)
            scene.show_fingers(*shot[2:], opacity=0.3 if near else 0.45)
            out.append(scene.draw_view(size, camera))
            pixel["close_pixel" if near else "wide_pixel"].append(2.0 * camera.reach / size[1])
    scene.close()
    sizes = {name: np.array(values) for name, values in pixel.items()}
    return {"wide": np.array(wide), "close": np.array(close), "newton": np.array(scale), **sizes}


def ball_centres(tips: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Centres [m] (m,3) of the balls that represent the fingertip, at all finite tips [m] (k,3)."""
    balls = tips + FINGER_RADIUS * normals
    return balls[np.isfinite(balls).all(axis=1)]


def _longest(vertices: np.ndarray) -> float:
    """Length of the arrow of the largest force [m]."""
    return min(ARROW, ARROW_SHARE * float(np.ptp(vertices, axis=0).max()))


@dataclass(frozen=True)
class Camera:
    """A view in parallel projection: focus and position [m] (3), and half of the height that it shows, reach [m]."""

    focus: np.ndarray
    position: np.ndarray
    reach: float


class Scene:
    """The surface, its fingers and their arrows in one off-screen window.

    vertices   (V,3) [m] at rest
    triangles  (T,3)
    most       end of the colour scale
    colours    (c,4) from its begin to its end, as RGBA bytes
    fingers    largest number of fingers
    """

    def __init__(
        self, vertices: np.ndarray, triangles: np.ndarray, most: float, colours: np.ndarray, fingers: int
    ) -> None:
        with collection_suspended():
            import pyvista.plotting

        self._pyvista, self._triangles = pyvista, triangles
        self._plotter = pyvista.Plotter(off_screen=True, lighting="none")
        self._plotter.set_background("white")
        self._plotter.disable_anti_aliasing()
        for place, strength in LIGHTS:
            light = pyvista.Light(position=place, intensity=strength, light_type="scene light")
            light.positional = False
            self._plotter.add_light(light)
        self._surface = self._plotter.add_mesh(
            self._mesh(vertices, np.zeros(len(vertices))), scalars="value",
            cmap=pyvista.LookupTable(values=colours, scalar_range=(0.0, most)), show_scalar_bar=False, color="white",
            ambient=0.28, diffuse=0.85, specular=0.12, specular_power=20.0, edge_color=EDGES, edge_opacity=0.35,
            line_width=0.4,
        )  # fmt: skip
        self._surface.prop.interpolation = "Phong"
        ball = pyvista.Sphere(radius=FINGER_RADIUS, theta_resolution=48, phi_resolution=48)
        look = {"color": "#7fa8c9", "smooth_shading": True, "ambient": 0.3, "specular": 0.3, "specular_power": 100.0}
        self._fingers = [
            (self._plotter.add_mesh(ball, **look), self._plotter.add_mesh(ball, color="#1f3b57", ambient=0.3))
            for _ in range(fingers)
        ]

    def show_surface(self, vertices: np.ndarray, values: np.ndarray, edges: bool) -> None:
        """The surface with vertices [m] (V,3), the values (V) of their colours, and the edges of the triangles."""
        self._surface.mapper.dataset = self._mesh(vertices, values).compute_normals(cell_normals=False)
        self._surface.prop.show_edges = edges

    def show_fingers(self, tips: np.ndarray, normals: np.ndarray, arrows: np.ndarray, opacity: float) -> None:
        """A ball above each finite tip [m] (f,3) along its normal (f,3), and an arrow (f,3) [m] from its centre."""
        for (ball, pointer), tip, normal, arrow in zip(self._fingers, tips, normals, arrows, strict=True):
            length = float(np.linalg.norm(arrow))
            ball.visibility = bool(np.isfinite(tip).all())
            pointer.visibility = ball.visibility and length > SHORTEST
            if ball.visibility:
                ball.position = centre = tip + FINGER_RADIUS * normal
                ball.prop.opacity = opacity
            if pointer.visibility:
                pointer.mapper.dataset = self._pyvista.Arrow(
                    start=centre, direction=arrow, scale=length, tip_length=min(1.0, 5e-3 / length),
                    tip_radius=min(0.25, HEAD / length), shaft_radius=min(0.1, 0.55e-3 / length),
                )  # fmt: skip

    def draw_view(self, size: tuple[int, int], camera: Camera) -> np.ndarray:
        """The picture (h,w,3) as RGB bytes, of a size (w,h)."""
        view = self._plotter.camera
        view.parallel_projection = True
        view.focal_point, view.position, view.up = camera.focus, camera.position, (0.0, 0.0, 1.0)
        view.parallel_scale = camera.reach
        self._plotter.reset_camera_clipping_range()
        self._plotter.window_size = size  # draws, except the first time, when `screenshot` does
        return np.array(self._plotter.screenshot(return_img=True))

    def close(self) -> None:
        self._plotter.close()

    def _mesh(self, vertices: np.ndarray, values: np.ndarray) -> Any:
        mesh = self._pyvista.PolyData.from_regular_faces(vertices, self._triangles)
        mesh["value"] = values
        return mesh


def place_camera(
    size: tuple[int, int], vertices: np.ndarray, balls: np.ndarray, heads: np.ndarray, shot: tuple, near: bool
) -> Camera:
    """Fill a picture of this size with the whole surface, the fingers and the heads of their arrows, or with a close-up
    of the fingers."""
    direction = np.array(VIEW) / np.linalg.norm(VIEW)
    axes = np.array([RIGHT, np.cross(direction, RIGHT), direction])
    seen, round_it, ahead = vertices @ axes.T, balls @ axes.T, heads @ axes.T
    low = np.concatenate([seen, round_it - FINGER_RADIUS, ahead - HEAD]).min(axis=0)
    high = np.concatenate([seen, round_it + FINGER_RADIUS, ahead + HEAD]).max(axis=0)
    focus = (low + high) / 2 @ axes
    width, height = size
    reach = MARGIN * max(high[1] - low[1], (high[0] - low[0]) * height / width) / 2
    there = np.isfinite(shot[2]).all(axis=1)
    if near and there.any():
        tips, arrows = shot[2][there], shot[4][there]
        focus = (tips + 0.4 * arrows).mean(axis=0)
        ends = np.abs((np.concatenate([tips, tips + arrows]) - focus) @ axes[:2].T).max(axis=0)
        across = 1.2 * max(ends[1], ends[0] * height / width)
        reach = max(NEAR * reach, across if len(tips) > 1 else 0.0)
    position = focus + 4.0 * float(np.linalg.norm(high - low)) * direction
    return Camera(focus, position, float(reach))


def main() -> None:
    source, target = sys.argv[1:3]
    with np.load(source) as views:
        pixels = render(dict(views))
    np.savez(target, **pixels)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
