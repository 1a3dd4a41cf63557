"""The lights of UsdLux, a reader a type: shape and image of a prim, its scale included.

A light that is scaled by different factors is one of the same kind where its shape allows it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from lookdev.errors import EnvironmentMapError
from lookdev.light.cylinder import CylinderLight
from lookdev.light.disk import DiskLight
from lookdev.light.distant import DistantLight
from lookdev.light.dome import prepare_light
from lookdev.light.dome.environment import EnvironmentMap, load_environment
from lookdev.light.dome.local import LocalDome
from lookdev.light.picture import prepare_texture
from lookdev.light.placed import PlacedLight
from lookdev.light.placement import Axes, Vector, checked_axes
from lookdev.light.protocol import Light
from lookdev.light.rect import RectLight
from lookdev.light.rig.attributes import LightPrim
from lookdev.light.rig.images import FORMATS
from lookdev.light.sphere import SphereLight

Floats = NDArray[np.float64]

DOME_Y: Floats = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
DOME_Z: Floats = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Where a dome's own space has x, y and z, the columns, of the frame of its map (`lookdev.light.mapping`).

UsdLuxDomeLight: "Latitude 0, longitude 0 points into positive z direction; and latitude 0, longitude pi/2 points into
positive x direction", the pole being +y. UsdLuxDomeLight_1, with the pole +z: "latitude 0, longitude 0 will instead
point into the negative Y direction". Longitude 0 is the middle of the image, the map's +x; pi/2 is left of it, +y.
"""

_SAME = 1e-5  # relative: scales that differ by less are one, as float32 has them
_FALLOFF = tuple(f"falloff:{each}" for each in ("virtualDistance", "exponent", "start", "end"))
_ALL = ("turns", "camera", "lightGroup")


@dataclass(frozen=True, eq=False)
class Placed:
    """A light prim to be built: its place and scales in metres, its axes, and whether domes need tables to sample."""

    light: LightPrim
    position: Vector
    axes: Axes
    scale: Vector
    y_up: bool
    sampled: bool


@dataclass(frozen=True)
class Shape:
    """What is read of a prim beside its emission.

    `make` makes the light, of emission 1, from its image if it has one. Where power is normalized, it is divided by
    `area`, in square metres, or by `size`, of a light without an area. `lengths` are in metres. `image` is a file, of
    the colour space `space` if one is stated, and of the format `format` if the light is a dome.
    """

    make: Callable[[EnvironmentMap | None], Light]
    area: float | None = None
    size: float = 1.0
    lengths: tuple[float, ...] = ()
    image: Path | None = None
    space: str = ""
    format: str = ""


@dataclass(frozen=True)
class Kind:
    """What reads the lights of a type, and the attributes below ``lookdev:`` that they have.

    A value that is wrong is reported as a fault, and stood in for.
    """

    read: Callable[[Placed], Shape]
    ours: tuple[str, ...] = (*_ALL, *_FALLOFF)


def _alike(given: Placed, first: int, second: int) -> float:
    """Return the scale along two axes; raises EnvironmentMapError where it differs."""
    a, b = given.scale[first], given.scale[second]
    if abs(a - b) > _SAME * max(a, b):
        kind = given.light.prim.GetTypeName()
        raise EnvironmentMapError(
            f"is scaled by {a:.6g} along {'xyz'[first]} and {b:.6g} along {'xyz'[second]}; the same scale along both "
            f"would be right for a {kind}"
        )
    return a


def _length(given: Placed, name: str, scale: float) -> float:
    """Return a length in metres."""
    return scale * given.light.number(f"inputs:{name}", above=0.0, default=1.0)


def _rect(given: Placed) -> Shape:
    width, height = (_length(given, name, given.scale[i]) for i, name in enumerate(("width", "height")))
    light = RectLight(width=width, height=height, position=given.position, axes=given.axes)
    image, space = _image(given)

    def make(picture: EnvironmentMap | None) -> Light:
        return light if picture is None else replace(light, texture=prepare_texture(picture))

    return Shape(make, light.size_factor, lengths=(width, height), image=image, space=space)


def _disk(given: Placed) -> Shape:
    radius = _length(given, "radius", 1.0)
    x, y = given.scale[0] * radius, given.scale[1] * radius
    return _shape(DiskLight(radii=(x, y), position=given.position, axes=given.axes), x, y)


def _sphere(given: Placed) -> Shape:
    radius = _radius(given, "treatAsPoint", "sphere", (0, 2))
    return _shape(SphereLight(radius=radius, position=given.position, axes=given.axes), radius)


def _cylinder(given: Placed) -> Shape:
    radius, length = _radius(given, "treatAsLine", "cylinder"), _length(given, "length", given.scale[0])
    return _shape(CylinderLight(length=length, radius=radius, position=given.position, axes=given.axes), length, radius)


def _shape(light: PlacedLight, *lengths: float) -> Shape:
    return Shape(lambda _: light, light.size_factor, lengths=lengths)


def _radius(given: Placed, hint: str, shape: str, others: tuple[int, ...] = (2,)) -> float:
    """Return the radius of a light that other renderers may take for a point or a line.

    "Renderers that only support area lights can disregard this": what sends light has a surface here, for it is seen in
    mirrors.
    """
    if given.light.flag(hint):
        given.light.note(hint, f"is disregarded: the light is a {shape} of its radius; a small radius would be right")
    radius = _length(given, "radius", given.scale[1])
    for other in others:
        _alike(given, *sorted((1, other)))
    return radius


def _distant(given: Placed) -> Shape:
    light = DistantLight(angle=given.light.number("inputs:angle", least=0.0), axes=given.axes)
    return Shape(lambda _: light, size=light.size_factor)


def _dome(given: Placed) -> Shape:
    return _of_pole(given, DOME_Y)


def _dome_1(given: Placed) -> Shape:
    axis = given.light.text("poleAxis", "scene", ("scene", "Y", "Z"))
    up = UsdGeom.Tokens.y if given.y_up else UsdGeom.Tokens.z
    return _of_pole(given, DOME_Y if (up if axis == "scene" else axis) == UsdGeom.Tokens.y else DOME_Z)


def _of_pole(given: Placed, pole: Floats) -> Shape:
    prim, local = given.light, "lookdev:local:radius"
    kind = prim.text("inputs:texture:format", "automatic", FORMATS)
    image, space = _image(given)
    radius = given.scale[0] * prim.number(local, above=0.0, default=1.0) if prim.has(local) else None
    edge = prim.number("lookdev:local:edge", least=0.0)
    axes = checked_axes(np.round(pole.T @ np.array(given.axes), 12) + 0.0)
    if edge > 1.0:
        prim.fault("lookdev:local:edge", f"is {edge:g}", "a part of the radius, from 0 to 1, would be right")
    if radius is None and prim.has("lookdev:local:edge"):
        prim.fault("lookdev:local:edge", "has no effect without a radius", f"'{local}' is missing")
    if prim.prim.GetRelationship("portals").HasAuthoredTargets():
        prim.note("portals", "has no effect: portals guide the sampling of other renderers")
    # Without an image it is the same all around.
    if image and not given.y_up and abs(axes[2][2]) < 0.5 and prim.prim.GetTypeName() == "DomeLight":
        what = "is +y, and horizontal here, though z is up in the stage; a DomeLight_1 has one that is up"
        prim.note("", f"the pole of a DomeLight {what}")
    for number in (1, 2):
        _alike(given, 0, number)

    def make(picture: EnvironmentMap | None) -> Light:
        environment = load_environment(builtin="white") if picture is None else picture
        local = radius is not None
        dome = replace(prepare_light(environment, sampled=given.sampled, local=local), axes=axes)
        if radius is None:
            return dome
        return LocalDome(dome=dome, position=given.position, radius=radius, edge=edge)

    lengths = () if radius is None else (radius,)
    return Shape(make, lengths=lengths, image=image, space=space, format=kind)


def _image(given: Placed) -> tuple[Path | None, str]:
    """Return the image file of a light, if it has one, and its colour space if one is stated."""
    name = "inputs:texture:file"
    return given.light.file(name), given.light.space(name)


KINDS: Mapping[str, Kind] = {
    "RectLight": Kind(_rect),
    "DiskLight": Kind(_disk),
    "SphereLight": Kind(_sphere),
    "CylinderLight": Kind(_cylinder),
    "DistantLight": Kind(_distant, _ALL),
    "DomeLight": Kind(_dome, (*_ALL, "local:radius", "local:edge")),
    "DomeLight_1": Kind(_dome_1, (*_ALL, "local:radius", "local:edge")),
}
"""The types of prims that are lights here, by their names in UsdLux."""

UNSUPPORTED: Mapping[str, str] = {
    "PortalLight": "a portal guides the sampling of other renderers, and is not needed here: deactivate it",
    "GeometryLight": "lights of a shape: a RectLight, DiskLight, SphereLight or CylinderLight would be right",
    "PluginLight": "a light of UsdLux would be right",
}
"""The types that are not, and what would be right."""
