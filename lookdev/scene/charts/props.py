"""The positions of reference props in a frame, and the scene in which they are rendered.

The scene has the lights of the asset, but not the asset. The props are side by side in the plane through the middle of
the asset that faces the camera. Their own camera has a long lens, so that balls are round even in the corner of a wide
picture. The props are one asset that counts as convex: they neither shadow nor reflect each other.

The props fill a *strip* along one edge of the frame, and the picture of the asset fills the rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Self, cast

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset, Instance, Mesh, Slot, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.errors import AssetError
from lookdev.light import Light
from lookdev.material import Layer, Look, Primvar
from lookdev.scene.camera import Camera
from lookdev.scene.charts.colorchecker import GREY_REFLECTANCE, PATCHES, patch_colors
from lookdev.scene.scene import Film, Scene, link_lights
from lookdev.space import REC709, Space

FrameSide = Literal["bottom", "top", "left", "right"]

PROPS_FOLDER = "charts"
"""The folder of the frames of props in an output, beside the folders of looks."""

PROPS_STRIP_KEY = "charts.strip"
"""The entry with the `Strip.label` in the headers of frames of props."""

_LENS = 2.0  # degrees: the angle of view; the direction of view differs from the camera's axis by at most 1 degree
_PADDING, _GAP = 0.08, 0.2  # relative to the strip's thickness: space beside the props, and between two of them
_ROWS, _COLUMNS = 4, 6  # rows and columns of the chart: a *cell* is a square of the chart with a patch in its middle
_SEAM = 0.12  # the space between a patch and the edge of its cell, relative to the cell's side
_BORDER = 0.03  # the reflectance of the chart between patches
# The side of a measured square, relative to the ball's diameter, and to the cell's side: the square contains no edge.
_BALL_PART, _CELL_PART = 0.5, 0.72
_SEGMENTS = 256  # segments of a ball around its axis
_MIN_PIXELS = 2.0  # the minimum number of whole pixels along the side of a measured square

MATTE = Look(
    "matte",
    (
        Layer(
            "Matte",
            "lambert",
            {"reflectance": Primvar("reflectance", (GREY_REFLECTANCE, GREY_REFLECTANCE, GREY_REFLECTANCE))},
        ),
    ),
)
CHROME = Look("chrome", (Layer("Chrome", "mirror", {"metal": "chromium"}),))


@dataclass(frozen=True)
class Box:
    """A rectangle of a frame in pixels, the origin in its upper left corner."""

    left: float
    top: float
    width: float
    height: float

    @property
    def center(self) -> tuple[float, float]:
        """The centre of the box, (x, y)."""
        return self.left + 0.5 * self.width, self.top + 0.5 * self.height

    def centered_square(self, part: float) -> Box:
        """Return the square with the same centre whose side is the fraction `part` of the shorter side of the box."""
        side = part * min(self.width, self.height)
        x, y = self.center
        return Box(x - 0.5 * side, y - 0.5 * side, side, side)


@dataclass(frozen=True)
class Strip:
    """The strip of a frame in which the props are, along the edge `side`.

    `size` is its thickness relative to the frame's height (bottom, top) or width (left, right). `resolution` is the
    width and height of the frame in pixels.
    """

    side: FrameSide
    size: float
    resolution: tuple[int, int]

    @property
    def label(self) -> str:
        """The side and the size as text, which determine the strip in a frame of any resolution."""
        return f"{self.side} {self.size!r}"

    @classmethod
    def of_label(cls, label: str, resolution: tuple[int, int]) -> Self:
        """Return the strip of a `label` in a frame of a resolution."""
        side, _, size = label.partition(" ")
        return cls(cast("FrameSide", side), float(size), resolution)

    @property
    def is_vertical(self) -> bool:
        """Whether the props are above one another."""
        return self.side in ("left", "right")

    @property
    def thickness(self) -> float:
        """The thickness in pixels."""
        return self.size * self.resolution[0 if self.is_vertical else 1]

    @property
    def picture_size(self) -> tuple[float, float]:
        """The width and height in pixels of the frame without the strip, where the picture of the asset is."""
        width, height = self.resolution
        return (width - self.thickness, float(height)) if self.is_vertical else (float(width), height - self.thickness)

    @property
    def shift(self) -> tuple[float, float]:
        """The `Camera.shift` that moves the centre of the picture to the middle of the frame without the strip."""
        half = 0.5 * self.thickness / self.resolution[0]
        sides = {"bottom": (0.0, -half), "top": (0.0, half), "left": (-half, 0.0), "right": (half, 0.0)}
        return sides[self.side]

    @property
    def box(self) -> Box:
        """The rectangle of the whole strip."""
        width, height = self.resolution
        across = self.thickness
        if self.is_vertical:
            return Box(0.0 if self.side == "left" else width - across, 0.0, across, float(height))
        return Box(0.0, 0.0 if self.side == "top" else height - across, float(width), across)

    @property
    def props(self) -> tuple[Box, Box, Box]:
        """The rectangles of the chrome ball, the grey ball and the chart, centred along the strip."""
        across = (1.0 - 2.0 * _PADDING) * self.thickness
        aspect = _COLUMNS / _ROWS
        sizes = [(across, across)] * 2 + [(across, across / aspect) if self.is_vertical else (across * aspect, across)]
        gap = _GAP * self.thickness
        x, y = self.box.center
        lengths = [size[self.is_vertical] for size in sizes]
        along = (y if self.is_vertical else x) - 0.5 * (sum(lengths) + 2.0 * gap)
        boxes = []
        for (width, height), length in zip(sizes, lengths, strict=True):
            left, top = (x - 0.5 * width, along) if self.is_vertical else (along, y - 0.5 * height)
            boxes.append(Box(left, top, width, height))
            along += length + gap
        return boxes[0], boxes[1], boxes[2]

    @property
    def measured_boxes(self) -> dict[str, Box]:
        """The squares whose mean colours are measured, by name: in the middle of the grey ball and of each patch."""
        _, grey, chart = self.props
        cell = chart.width / _COLUMNS
        cells = {
            name: Box(chart.left + (i % _COLUMNS) * cell, chart.top + (i // _COLUMNS) * cell, cell, cell)
            for i, name in enumerate(PATCHES)
        }
        return {
            "grey ball": grey.centered_square(_BALL_PART),
            **{name: box.centered_square(_CELL_PART) for name, box in cells.items()},
        }

    def fit_fault(self) -> tuple[str, str]:
        """Return the reason why the props do not fit into the strip, and a hint; both "" if they fit."""
        chrome, _, chart = self.props
        length = self.resolution[1 if self.is_vertical else 0]
        used = chart.top + chart.height - chrome.top if self.is_vertical else chart.left + chart.width - chrome.left
        if used > length:
            most = math.floor(1e3 * self.size * length / used) / 1e3
            problem = f"the props need {math.ceil(used)} pixels along the {self.side} edge, the frame has {length}"
            return problem, f"size = {most:g} at most, or another place, would be right"
        return "", ""

    def size_note(self) -> str:
        """Return a note with a hint if the patches are too small to be measured; "" if they are large enough."""
        side = self.measured_boxes["black 2"].width
        # A square with a side of n + 1 pixels contains at least n whole pixels along it.
        if side >= _MIN_PIXELS + 1.0:
            return ""
        least = math.ceil(1e3 * self.size * (_MIN_PIXELS + 1.0) / side) / 1e3
        return (
            f"[charts] is not measured: {side:.1f} pixels across the middle of a patch are too few; size = {least:g} "
            "or a higher resolution would be right"
        )


def props_camera(camera: Camera, center: tuple[float, float, float]) -> Camera:
    """Return the camera of the props for a frame of `camera`.

    It looks in the same direction from far away. The plane of the props goes through the point of the camera's orbit
    axis at the height of `center`, the middle of the asset. Raises AssetError if that point is not in front of the
    camera.
    """
    right, up, back = camera.frame
    middle = np.array([*camera.pivot, center[2]])
    depth = float((camera.position - middle) @ back)
    if depth <= 0.0:
        raise AssetError("the middle of the asset is behind the camera, and with it the props of [charts]")
    shift_x, shift_y = (2.0 * shift * camera.half_width for shift in camera.shift)
    target = camera.position + depth * (shift_x * right + shift_y * up - back)
    distance = camera.half_width * depth / math.tan(math.radians(0.5 * _LENS))
    # Numbers are rounded, so that frames have the same digest on every machine.
    digits = 9 - math.floor(math.log10(distance))
    x, y, z = np.round(target, digits).tolist()
    straight = replace(camera, fov=_LENS, shift=(0.0, 0.0), lens=None, axis=camera.pivot)
    return replace(straight, target=(x, y, z), distance=round(distance, digits))


def props_scene(strip: Strip, camera: Camera, lights: Sequence[Light], space: Space = REC709) -> Scene:
    """Return the scene of the props in a strip under some lights; `camera` is a `props_camera`.

    The lights themselves are invisible. A light illuminates the props if its ``lightLink`` includes the path
    ``/charts``.
    """
    asset = asset_of_props(strip, camera)
    look_of_slot = {slot.path: CHROME if slot.path.endswith("chrome") else MATTE for slot in asset.slots}
    emissions = (replace(light.emission, camera=False, shadow_link=None) for light in lights)
    invisible_lights = tuple(light.with_emission(emission) for light, emission in zip(lights, emissions, strict=True))
    return link_lights(Scene(asset, look_of_slot, invisible_lights, camera, Film(strip.resolution, space)))


def asset_of_props(strip: Strip, camera: Camera, names: Sequence[str] = ("chrome", "grey", "chart")) -> Asset:
    """Return the props in a strip, or those with the given `names`, as one asset; `camera` is a `props_camera`."""
    meshes: list[Mesh] = []
    instances: list[Instance] = []
    slots: list[Slot] = []
    for name in names:
        mesh, matrix = _place_prop(name, strip, camera)
        slots.append(Slot(f"/{PROPS_FOLDER}/{name}"))
        instances.append(Instance(len(meshes), matrix, slots[-1].path))
        meshes.append(replace(mesh, name=slots[-1].path, face_slots=np.full_like(mesh.face_slots, len(meshes))))
    return make_asset(PROPS_FOLDER, meshes, instances, slots, convex=True)


def crop_camera(camera: Camera, resolution: tuple[int, int], box: Box) -> Camera:
    """Return the camera whose frame is the square `box` of the frame of `camera`, which has `resolution` pixels."""
    width, height = resolution
    x, y = box.center
    part = box.width / width
    shift = (x - 0.5 * width) / width, (0.5 * height - y) / width
    fov = math.degrees(2.0 * math.atan(part * camera.half_width))
    return replace(camera, fov=fov, shift=(shift[0] / part, shift[1] / part))


def _place_prop(name: str, strip: Strip, camera: Camera) -> tuple[Mesh, Floats]:
    """Return the mesh of a prop, and its matrix (4, 4) to the world."""
    chrome, grey, chart = strip.props
    box = {"chrome": chrome, "grey": grey, "chart": chart}[name]
    width, height = strip.resolution
    pixel = 2.0 * camera.half_width * camera.distance / width
    right, up, back = camera.frame
    x, y = box.center
    position = np.array(camera.target) + pixel * ((x - 0.5 * width) * right + (0.5 * height - y) * up)
    matrix = np.eye(4)
    # The chart's mesh is upright: it faces -y, its right is +x, and its up is +z.
    matrix[:3, :3] = pixel * np.stack([right, -back, up], axis=-1)
    matrix[:3, 3] = position
    if name == "chart":
        return _chart(box.width, box.height), matrix
    ball = make_sphere(_SEGMENTS, _SEGMENTS // 2)
    matrix[:3, :3] *= 0.5 * box.width
    mesh = replace(ball.meshes[0], uvs={}, default_uv="")
    grey_color = np.full((len(mesh.corner_points), 3), GREY_REFLECTANCE, np.float32)
    return (mesh if name == "chrome" else replace(mesh, primvars={"reflectance": grey_color})), matrix


def _chart(width: float, height: float) -> Mesh:
    """Return the mesh of the chart, patches between borders, in pixels; it faces -y and is centred at the origin."""
    xs, zs = (_edges(size, count) for size, count in ((width, _COLUMNS), (height, _ROWS)))
    colors = patch_colors().reshape(_ROWS, _COLUMNS, 3)
    points, face_colors = [], []
    for row, (low, high) in enumerate(pairwise(zs)):
        for column, (left, right) in enumerate(pairwise(xs)):
            points += [(left, 0.0, low), (right, 0.0, low), (right, 0.0, high), (left, 0.0, high)]
            is_patch = row % 2 == 1 and column % 2 == 1
            # Rows of patches are counted from the top, whereas z increases from the bottom.
            face_colors.append(colors[_ROWS - 1 - row // 2, column // 2] if is_patch else np.full(3, _BORDER))
    count = len(points)
    return Mesh(
        name="chart",
        points=np.array(points, np.float32),
        corner_points=np.arange(count, dtype=np.int32),
        face_sizes=np.full(count // 4, 4, np.int32),
        face_slots=np.zeros(count // 4, np.int32),
        normals=np.tile(np.array([0, -1, 0], np.float32), (count, 1)),
        tangents=np.tile(np.array([1, 0, 0], np.float32), (count, 1)),
        uvs={},
        primvars={"reflectance": np.repeat(np.array(face_colors, np.float32), 4, axis=0)},
    )


def _edges(size: float, cells: int) -> list[float]:
    """Return the coordinates of the edges between borders and patches along a side, centred at 0."""
    cell = size / cells
    starts = -0.5 * size + np.arange(cells) * cell
    patches = np.stack([starts + _SEAM * cell, starts + (1.0 - _SEAM) * cell], axis=-1)
    return [-0.5 * size, *patches.ravel().tolist(), 0.5 * size]
