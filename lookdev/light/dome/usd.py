"""Reader of dome lights in USD, infinitely far or local, and the `LightKind` of both kinds."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

import numpy as np

from lookdev.arrays import Floats
from lookdev.light.base import Light, LightKind
from lookdev.light.dome import Dome, example_dome, prepare_light
from lookdev.light.dome.environment import EnvironmentMap, load_environment
from lookdev.light.dome.local import LocalDome, example_local_dome
from lookdev.light.placement import checked_axes
from lookdev.light.usd import LIGHT_ATTRIBUTES, PlacedPrim, UsdLight, UsdLightShape

DOME_Y: Floats = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
DOME_Z: Floats = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""The axes of a map (`lookdev.light.mapping`) in the own space of a dome with the pole +y, and with the pole +z.

The columns are the map's x, y and z axes.

UsdLuxDomeLight: "Latitude 0, longitude 0 points into positive z direction; and latitude 0, longitude pi/2 points into
positive x direction", the pole being +y. UsdLuxDomeLight_1, with the pole +z: "latitude 0, longitude 0 will instead
point into the negative Y direction". Longitude 0 is the middle of the image, the map's +x; pi/2 is left of it, +y.
"""

BALLS = ("mirroredBall", "angular")
"""The formats of an image that shows the reflection in a ball (`lookdev.light.rig.images`)."""

FORMATS = ("automatic", "latlong", *BALLS, "cubeMapVerticalCross")


def _read(prim: PlacedPrim) -> UsdLightShape:
    light, local = prim.light, "lookdev:local:radius"
    pole_axis = light.text("poleAxis", "scene", ("scene", "Y", "Z")) if prim.kind == "DomeLight_1" else "Y"
    pole = DOME_Y if pole_axis == "Y" or (pole_axis == "scene" and prim.y_up) else DOME_Z
    image_format = light.text("inputs:texture:format", "automatic", FORMATS)
    image, space = prim.image
    radius = prim.scale[0] * light.number(local, above=0.0, default=1.0) if light.has(local) else None
    edge = light.number("lookdev:local:edge", least=0.0)
    axes = checked_axes(np.round(pole.T @ np.array(prim.axes), 12) + 0.0)
    if edge > 1.0:
        light.fault("lookdev:local:edge", f"is {edge:g}", "a part of the radius, from 0 to 1, would be right")
    if radius is None and light.has("lookdev:local:edge"):
        light.fault("lookdev:local:edge", "has no effect without a radius", f"'{local}' is missing")
    if light.prim.GetRelationship("portals").HasAuthoredTargets():
        light.note("portals", "has no effect: portals guide the sampling of other renderers")
    # Without an image, the dome is constant and its pole has no effect.
    if image and not prim.y_up and abs(axes[2][2]) < 0.5 and prim.kind == "DomeLight":
        problem = "is +y, and horizontal here, though z is up in the stage; a DomeLight_1 has one that is up"
        light.note("", f"the pole of a DomeLight {problem}")
    for axis in (1, 2):
        prim.check_scales(0, axis)

    def make(picture: EnvironmentMap | None) -> Light:
        environment = load_environment(builtin="white") if picture is None else picture
        dome = replace(prepare_light(environment, sampled=prim.sampled, local=radius is not None), axes=axes)
        if radius is None:
            return dome
        return LocalDome(dome=dome, position=prim.position, radius=radius, edge=edge)

    lengths = () if radius is None else (radius,)
    return UsdLightShape(make, lengths=lengths, image=image, space=space, format=image_format)


_READER = UsdLight(_read, (*LIGHT_ATTRIBUTES, "local:radius", "local:edge"))
_USD = {"DomeLight": _READER, "DomeLight_1": _READER}

DOME = LightKind(Dome, example_dome, _USD, files("lookdev") / "shaders" / "dome.osl.h")
LOCAL_DOME = LightKind(LocalDome, example_local_dome)
