"""Renders the deformed surface with VTK in a subprocess, so that a crash of the graphics driver ends only this one.

python -m palpate.views.surface.render views.npz pixels.npz

VTK is used without pyvista, which imports matplotlib's windows: 1.2 s of processor time, three times what nine views
need. One scene is moved on from view to view. Two pixels are drawn for each one that a picture shows, in place of
multisampling, which costs five times as much in software.
"""

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

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
    triangles = views["triangles"]
    scale = _longest(views["vertices"]) / max(float(views["greatest"]), LEAST_FORCE)
    arrows, balls = views["forces"] * scale, views["balls"]
    heads = balls + views["pulls"] * scale
    shots = list(zip(views["displacement"], views["values"], views["tips"], views["normals"], arrows, strict=True))
    scene = Scene(triangles, float(views["most"]), views["colours"])
    wide: list[np.ndarray] = []
    close: list[np.ndarray] = []
    pixel: dict[str, list[float]] = {"wide_pixel": [], "close_pixel": []}
    for size, out, which in ((SIZE, wide, range(len(shots))), (CLOSE_SIZE, close, views["near"].tolist())):
        near = out is close
        for shot in (shots[i] for i in which):
            camera = place_camera(size, views["vertices"], balls, heads, shot, near)
            scene.show_surface(views["vertices"] + shot[0], shot[1], edges=near)
            scene.show_fingers(*shot[2:], opacity=0.3 if near else 0.45)
            out.append(scene.draw(size, camera))
            pixel["close_pixel" if near else "wide_pixel"].append(2.0 * camera.reach / size[1])
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

    triangles  (T,3)
    most       end of the colour scale
    colours    (c,4) from its begin to its end, as RGBA bytes
    """

    def __init__(self, triangles: np.ndarray, most: float, colours: np.ndarray) -> None:
        import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  the classes below draw with it
        from vtkmodules import vtkCommonCore, vtkCommonDataModel, vtkFiltersSources, vtkRenderingCore
        from vtkmodules.util import numpy_support

        self._core, self._models, self._drawing = vtkCommonCore, vtkCommonDataModel, vtkRenderingCore
        self._sources, self._arrays = vtkFiltersSources, numpy_support
        self._triangles = triangles
        self._cells = vtkCommonDataModel.vtkCellArray()
        begins = np.arange(0, triangles.size + 1, 3, dtype=np.int64)
        corners = np.ascontiguousarray(triangles, dtype=np.int64).ravel()
        self._cells.SetData(*(numpy_support.numpy_to_vtkIdTypeArray(ids, deep=True) for ids in (begins, corners)))
        self._window = vtkRenderingCore.vtkRenderWindow()
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._renderer = vtkRenderingCore.vtkRenderer()
        self._renderer.SetBackground(1.0, 1.0, 1.0)
        self._renderer.AutomaticLightCreationOff()
        self._window.AddRenderer(self._renderer)
        for place, strength in LIGHTS:
            self._add_light(place, strength)
        self._surface = self._add_actor(ambient=0.28, diffuse=0.85, specular=0.12, power=20.0)
        edges = self._surface.GetProperty()
        edges.SetEdgeColor(*_rgb(EDGES))
        edges.SetEdgeOpacity(0.35)
        edges.SetLineWidth(0.4)
        table = vtkCommonCore.vtkLookupTable()
        table.SetTable(numpy_support.numpy_to_vtk(colours, deep=True))
        table.SetRange(0.0, most)
        mapper = self._surface.GetMapper()
        mapper.SetLookupTable(table)
        mapper.UseLookupTableScalarRangeOn()
        mapper.InterpolateScalarsBeforeMappingOn()
        self._fingers: list[tuple[Any, Any]] = []

    def show_surface(self, vertices: np.ndarray, values: np.ndarray, edges: bool) -> None:
        """The surface with vertices [m] (V,3), the values (V) of their colours, and the edges of the triangles."""
        shape = self._models.vtkPolyData()
        points = self._core.vtkPoints()
        points.SetData(self._columns(vertices))
        shape.SetPoints(points)
        shape.SetPolys(self._cells)
        shape.GetPointData().SetScalars(self._columns(values))
        shape.GetPointData().SetNormals(self._columns(smooth_normals(vertices, self._triangles)))
        self._surface.GetMapper().SetInputData(shape)
        self._surface.GetProperty().SetEdgeVisibility(edges)

    def show_fingers(self, tips: np.ndarray, normals: np.ndarray, arrows: np.ndarray, opacity: float) -> None:
        """A ball above each finite tip [m] (f,3) along its normal (f,3), and an arrow (f,3) [m] from its centre."""
        while len(self._fingers) < len(tips):
            self._fingers.append((self._add_ball(), self._add_actor(ambient=0.3, colour="#1f3b57")))
        for (ball, pointer), tip, normal, arrow in zip(self._fingers, tips, normals, arrows, strict=True):
            there = bool(np.isfinite(tip).all())
            length = float(np.linalg.norm(arrow))
            ball.SetVisibility(there)
            pointer.SetVisibility(there and length > SHORTEST)
            if not there:
                continue
            centre = tip + FINGER_RADIUS * normal
            ball.SetPosition(*centre)
            ball.GetProperty().SetOpacity(opacity)
            if length > SHORTEST:
                self._point(pointer, centre, arrow, length)

    def draw(self, size: tuple[int, int], camera: Camera) -> np.ndarray:
        """The picture (h,w,3) as RGB bytes, of a size (w,h)."""
        width, height = size
        if self._window.GetSize() != size:
            self._window.SetSize(width, height)
        view = self._renderer.GetActiveCamera()
        view.ParallelProjectionOn()
        view.SetFocalPoint(*camera.focus)
        view.SetPosition(*camera.position)
        view.SetViewUp(0.0, 0.0, 1.0)
        view.SetParallelScale(camera.reach)
        self._renderer.ResetCameraClippingRange()
        self._window.Render()
        seen = self._core.vtkUnsignedCharArray()
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, seen, 0)
        return np.array(self._arrays.vtk_to_numpy(seen).reshape(height, width, 3)[::-1])

    def _columns(self, values: np.ndarray) -> Any:
        return self._arrays.numpy_to_vtk(np.ascontiguousarray(values, dtype=np.float32), deep=True)

    def _add_light(self, place: tuple[float, float, float], strength: float) -> None:
        light = self._drawing.vtkLight()
        light.SetLightTypeToSceneLight()
        light.PositionalOff()
        light.SetPosition(*place)
        light.SetIntensity(strength)
        self._renderer.AddLight(light)

    def _add_actor(
        self, ambient: float, diffuse: float = 1.0, specular: float = 0.0, power: float = 1.0, colour: str = "#ffffff"
    ) -> Any:
        actor = self._drawing.vtkActor()
        actor.SetMapper(self._drawing.vtkPolyDataMapper())
        look = actor.GetProperty()
        look.SetInterpolationToPhong()
        look.SetColor(*_rgb(colour))
        look.SetAmbient(ambient)
        look.SetDiffuse(diffuse)
        look.SetSpecular(specular)
        look.SetSpecularPower(power)
        self._renderer.AddActor(actor)
        return actor

    def _add_ball(self) -> Any:
        ball = self._sources.vtkSphereSource()
        ball.SetRadius(FINGER_RADIUS)
        ball.SetThetaResolution(48)
        ball.SetPhiResolution(48)
        actor = self._add_actor(ambient=0.3, specular=0.3, power=100.0, colour="#7fa8c9")
        actor.GetMapper().SetInputConnection(ball.GetOutputPort())
        return actor

    def _point(self, pointer: Any, start: np.ndarray, arrow: np.ndarray, length: float) -> None:
        """Make an actor the arrow of this length [m] from a point [m] (3)."""
        shape = self._sources.vtkArrowSource()  # along x, of length 1
        shape.SetTipLength(min(1.0, 5e-3 / length))
        shape.SetTipRadius(min(0.25, HEAD / length))
        shape.SetShaftRadius(min(0.1, 0.55e-3 / length))
        shape.SetTipResolution(20)
        shape.SetShaftResolution(20)
        pointer.GetMapper().SetInputConnection(shape.GetOutputPort())
        ahead = arrow / length
        aside = np.cross(ahead, np.eye(3)[np.abs(ahead).argmin()])
        aside /= np.linalg.norm(aside)
        place = np.eye(4)
        place[:3] = np.column_stack([length * ahead, length * aside, length * np.cross(ahead, aside), start])
        matrix = self._matrix()
        matrix.DeepCopy(place.ravel().tolist())
        pointer.SetUserMatrix(matrix)

    @staticmethod
    def _matrix() -> Any:
        from vtkmodules.vtkCommonMath import vtkMatrix4x4

        return vtkMatrix4x4()


def smooth_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals (V,3) at vertices [m] (V,3): means of those of the triangles (T,3) around each, weighted by area;
    zero at a vertex without triangles."""
    corners = vertices[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.column_stack(
        [np.bincount(triangles.ravel(), np.repeat(column, 3), minlength=len(vertices)) for column in facing.T]
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0.0)


def _rgb(colour: str) -> tuple[float, ...]:
    return tuple(part / 255.0 for part in bytes.fromhex(colour[1:]))


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
