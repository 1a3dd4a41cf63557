"""The lights of UsdLux, a builder a type: shape and image of a prim, its scale included.

A light that is scaled by different factors is one of the same kind where its shape allows it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

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
from lookdev.light.placement import Axes, Vector, checked_axes
from lookdev.light.protocol import Light
from lookdev.light.rect import RectLight
from lookdev.light.rig.attributes import LightPrim
from lookdev.light.rig.images import BALLS, FORMATS, read_light_image, stated_format, unrolled
from lookdev.light.rig.report import Report
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
    report: Report


@dataclass(frozen=True)
class Built:
    """A light of emission 1, the largest and the mean value of its image, and its file."""

    light: Light
    largest: float = 1.0
    mean: tuple[float, ...] = (1.0, 1.0, 1.0)
    image: str = ""


@dataclass(frozen=True)
class Kind:
    """What builds the lights of a type, and the attributes below ``lookdev:`` that they have."""

    build: Callable[[Placed], Built | None]
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


def _rect(given: Placed) -> Built | None:
    sides = [given.light.number(f"inputs:{name}", above=0.0) for name in ("width", "height")]
    image = _image(given)
    if not all(sides) or isinstance(image, str):
        return None
    light = RectLight(
        width=given.scale[0] * sides[0],
        height=given.scale[1] * sides[1],
        position=given.position,
        axes=given.axes,
        texture=prepare_texture(image) if image else None,
    )
    if image is None:
        return Built(light)
    mean = image.radiance.mean(axis=(0, 1), dtype=np.float64)
    return Built(light, float(image.radiance.max()), tuple(mean.tolist()), image.where)


def _disk(given: Placed) -> Built | None:
    radius = given.light.number("inputs:radius", above=0.0)
    if not radius:
        return None
    radii = given.scale[0] * radius, given.scale[1] * radius
    return Built(DiskLight(radii=radii, position=given.position, axes=given.axes))


def _sphere(given: Placed) -> Built | None:
    radius = _radius(given, "treatAsPoint", "sphere")
    if not radius:
        return None
    _alike(given, 0, 1)
    return Built(SphereLight(radius=radius * _alike(given, 1, 2), position=given.position, axes=given.axes))


def _cylinder(given: Placed) -> Built | None:
    radius = _radius(given, "treatAsLine", "cylinder")
    length = given.light.number("inputs:length", above=0.0)
    if not (radius and length):
        return None
    length, radius = given.scale[0] * length, radius * _alike(given, 1, 2)
    return Built(CylinderLight(length=length, radius=radius, position=given.position, axes=given.axes))


def _radius(given: Placed, hint: str, shape: str) -> float:
    """Return the radius of a light that other renderers may take for a point or a line.

    "Renderers that only support area lights can disregard this": what sends light has a surface here, for it is seen in
    mirrors.
    """
    if given.light.flag(hint):
        given.light.note(hint, f"is disregarded: the light is a {shape} of its radius; a small radius would be right")
    return given.light.number("inputs:radius", above=0.0)


def _distant(given: Placed) -> Built | None:
    return Built(DistantLight(angle=given.light.number("inputs:angle", least=0.0), axes=given.axes))


def _dome(given: Placed) -> Built | None:
    return _built_dome(given, DOME_Y)


def _dome_1(given: Placed) -> Built | None:
    axis = given.light.text("poleAxis", "scene", ("scene", "Y", "Z"))
    up = UsdGeom.Tokens.y if given.y_up else UsdGeom.Tokens.z
    return _built_dome(given, DOME_Y if (up if axis == "scene" else axis) == UsdGeom.Tokens.y else DOME_Z)


def _built_dome(given: Placed, pole: Floats) -> Built | None:
    for number in (1, 2):
        _alike(given, 0, number)
    light, report = given.light, given.report
    if light.prim.GetRelationship("portals").HasAuthoredTargets():
        light.note("portals", "has no effect: portals guide the sampling of other renderers")
    image = _image(given)
    if image is None:
        return _as_dome(given, load_environment(builtin="white"), pole, "")
    if not isinstance(image, str):
        with report.collected(light.path.AppendProperty("inputs:texture:file")):
            return _as_dome(given, _lat_long(given, image), pole, image.where)
    return None


def _lat_long(given: Placed, image: EnvironmentMap) -> EnvironmentMap:
    """Return the image of a dome as a lat-long map; raises EnvironmentMapError where it cannot be one."""
    kind = given.light.text("inputs:texture:format", "automatic", FORMATS)
    kind = stated_format(image) if kind == "automatic" else kind
    if kind == "cubeMapVerticalCross":
        raise EnvironmentMapError(
            f"{image.where}: is a cube map, of format {kind}, which is not supported; a lat-long map would be right"
        )
    if kind not in BALLS:
        return image
    made = unrolled(image, kind)
    height, width = made.environment.radiance.shape[:2]
    what = f"of format {kind}, turned into a lat-long map of {width} x {height}; its power is off by {made.error:.2g}"
    given.light.note("inputs:texture:file", f"{image.where}: {what}")
    return made.environment


def _as_dome(given: Placed, environment: EnvironmentMap, pole: Floats, image: str) -> Built:
    axes = checked_axes(np.round(pole.T @ np.array(given.axes), 12) + 0.0)
    dome = replace(prepare_light(environment, sampled=given.sampled), axes=axes)
    if not given.y_up and abs(axes[2][2]) < 0.5 and given.light.prim.GetTypeName() == "DomeLight":
        given.report.note(
            given.light.path,
            "its pole is horizontal: that of a DomeLight is +y, though z is up in the stage; for a pole that is up, a "
            "DomeLight_1 would be right",
        )
    light: Light = dome
    if given.light.has("lookdev:local:radius"):
        radius = given.scale[0] * given.light.number("lookdev:local:radius", above=0.0, default=1.0)
        edge = given.light.number("lookdev:local:edge", least=0.0)
        light = LocalDome(dome=dome, position=given.position, radius=radius, edge=edge)
    elif given.light.has("lookdev:local:edge"):
        given.light.fault("lookdev:local:edge", "has no effect without a radius", "'lookdev:local:radius' is missing")
    mean = lat_long_mean(environment.radiance)
    return Built(light, float(environment.radiance.max()), mean, image)


def lat_long_mean(radiance: NDArray[np.float32]) -> tuple[float, ...]:
    """Return the mean over the sphere of a lat-long map (H, W, 3)."""
    edges = np.cos(np.pi * np.arange(len(radiance) + 1) / len(radiance))
    return tuple((radiance.mean(axis=1, dtype=np.float64).T @ -np.diff(edges) / 2.0).tolist())


def _image(given: Placed) -> EnvironmentMap | str | None:
    """Return the image of a light, None where it has none, and "" where it cannot be read."""
    name = "inputs:texture:file"
    light, report = given.light, given.report
    before = len(report.faults)
    file, space = light.file(name), light.space(name)
    if file is not None:
        with report.collected(light.path.AppendProperty(name)):
            environment = read_light_image(file, space)
            if environment.repairs:
                light.note(name, f"{file}: {environment.repairs}")
            return environment
    return "" if len(report.faults) > before else None


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
