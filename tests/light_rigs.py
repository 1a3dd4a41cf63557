"""Rigs for tests of the backends that render any light: sets of lights of all kinds, and looks to be lit by them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from frames import orbit_camera

from lookdev.arrays import Floats
from lookdev.asset import Instance, load_asset, make_asset
from lookdev.light import (
    LIGHT_KINDS,
    CylinderLight,
    DiskLight,
    DistantLight,
    Dome,
    Emission,
    Light,
    RectLight,
    Shadow,
    Shaping,
    SphereLight,
    make_environment,
    prepare_light,
)
from lookdev.light.dome.local import LocalDome
from lookdev.light.emission import Falloff, LightLink
from lookdev.light.ies import load_profile
from lookdev.light.picture import prepare_texture
from lookdev.material import Layer, Look
from lookdev.scene import Film, Scene
from lookdev.scene.scene import link_lights

FACING = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""The axes of a light that shines along +y: its x, its y, and the direction against its light."""

RIG_LOOKS = {
    "diffuse": Layer("l", "disney", {"baseColor": (0.8, 0.5, 0.3), "roughness": 0.6, "specular": 0.0}),
    "plastic": Layer("l", "disney", {"baseColor": (0.2, 0.5, 0.9), "roughness": 0.35, "clearcoat": 0.5}),
    "metal": Layer("l", "disney", {"baseColor": (0.9, 0.7, 0.4), "metallic": 1.0, "roughness": 0.25}),
    "wall-e": Layer("l", "pixar", {"surfaceColor": (0.5, 0.4, 0.3), "roughness": 0.4}),
    "leaf": Layer("l", "pixar", {"surfaceColor": (0.5, 0.4, 0.3), "roughness": 0.4, "back": 0.5}),
}
# An IES file: the intensity of a lamp, for 5 vertical and 4 horizontal angles.
PROFILE = """IESNA:LM-63-2002
TILT=NONE
1 1000 1 5 4 1 2 0 0 0
1 1 100
0 22.5 45 67.5 90
0 30 90 180
1 .9 .5 .2 0
1 .5 .8 .1 0
1 .2 .2 .9 0
1 .9 .1 .1 .4
"""


def sent(**fields: object) -> Emission:
    """Return the emission of the lights of these rigs; `fields` are other fields of `Emission`."""
    return Emission((6.0, 4.0, 2.0), **fields)  # type: ignore[arg-type]


def textured() -> RectLight:
    """Return a rectangle light in front of the asset, with a texture of a few bright spots."""
    radiance = np.zeros((24, 40, 3), np.float32)
    radiance[3:8, 5:9], radiance[12:20, 20:38], radiance[20:, :3] = (9.0, 3.0, 1.0), (0.2, 0.6, 2.0), (4.0, 8.0, 4.0)
    texture = prepare_texture(make_environment("spots", radiance))
    return RectLight(width=2.0, height=1.5, position=(0.0, -2.0, 0.5), axes=FACING, texture=texture)


def profiled(folder: Path) -> tuple[Light, ...]:
    """Return two lights with IES profiles, one of them with scaled angles; the profile is written to `folder`."""
    file = folder / "lamp.ies"
    file.write_text(PROFILE)
    plain, squeezed = load_profile(file), load_profile(file, angle_scale=0.5)
    return (
        SphereLight(radius=0.3, position=(-1.0, -1.6, 0.5), axes=FACING, emission=sent(shaping=Shaping(profile=plain))),
        replace(near("rect"), emission=sent(shaping=Shaping(profile=squeezed))),
    )


def near(kind: str) -> Light:
    """Return a light of a kind in front of the asset, or the example of a kind without a position."""
    position = (0.6, -1.8, 0.8)
    match kind:
        case "rect":
            return RectLight(width=1.2, height=0.8, position=position, axes=FACING, emission=sent())
        case "disk":
            return DiskLight(radii=(0.7, 0.4), position=position, axes=FACING, emission=sent())
        case "sphere":
            return SphereLight(radius=0.4, position=position, emission=sent())
        case "cylinder":
            return CylinderLight(length=1.5, radius=0.2, position=position, emission=sent())
        case "distant":
            return DistantLight(angle=20.0, axes=((1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.0, -0.8, 0.6)), emission=sent())
    return LIGHT_KINDS[kind].example()


def grey(*, local: bool = False) -> Dome:
    """Return a dome of uniform grey; `local` is that of `prepare_light`."""
    return prepare_light(make_environment("grey", np.full((2, 4, 3), 0.2, np.float32)), local=local)


KINDS = tuple(name for name, kind in LIGHT_KINDS.items() if kind.osl is None)
# The lights of each rig by its name, as functions of a folder in which they may write files.
RIGS: dict[str, Callable[[Path], tuple[Light, ...]]] = {
    **{kind: lambda folder, kind=kind: (near(kind),) for kind in KINDS},
    "local grey": lambda folder: (LocalDome(dome=grey(local=True), position=(0.3, 0.0, 0.5), radius=2.0, edge=0.5),),
    "texture": lambda folder: (textured(), near("dome")),
    "profile": profiled,
    "beam": lambda folder: (
        replace(near("rect"), emission=sent(shaping=Shaping(35.0, 0.5, 4.0, (0.1, 0.5, 0.0)))),
        SphereLight(radius=0.2, position=(-1.0, -1.6, 0.2), axes=FACING, emission=sent(shaping=Shaping(25.0))),
    ),
    "falloff": lambda folder: (
        replace(near("rect"), emission=sent(falloff=Falloff(1.5, 3.0, 1.0, 3.0))),
        replace(near("sphere"), position=(-1.0, -1.6, 0.2), emission=sent(falloff=Falloff(0.0, 1.0))),
    ),
    "shadow": lambda folder: (
        replace(near("rect"), emission=sent(shadow=Shadow(True, (0.5, 0.1, 0.0), 0.6, 0.4, 0.7))),
        replace(near("sphere"), position=(0.2, 0.5, 2.0), emission=sent(shadow=Shadow(enable=False))),
        replace(near("distant"), emission=sent(shadow=Shadow(distance=0.3))),
    ),
    "response": lambda folder: (
        replace(near("rect"), emission=sent(diffuse=0.3, specular=2.0)),
        replace(near("sphere"), position=(-1.0, -1.6, 0.2), emission=sent(diffuse=2.0, specular=0.0)),
    ),
    "still": lambda folder: (
        replace(near("rect"), emission=sent(turns=False)),
        near("disk"),
        replace(LIGHT_KINDS["dome"].example(), emission=sent(turns=False), axes=FACING),  # type: ignore[type-var]
    ),
    "seen": lambda folder: (
        SphereLight(radius=0.3, position=(-0.4, -1.8, 0.4), emission=sent(camera=True, turns=False)),
        grey(),
    ),
    "everything": lambda folder: (*map(near, (*KINDS, "dome")), grey()),
}


def row_of(placed: Mapping[str, Floats], lights: tuple[Light, ...], size: int) -> Scene:
    """Return a scene with instances of one mesh side by side, under lights with links to parts.

    `placed` has the matrix (4, 4) of each instance by the path of its parent; `size` is the side of the frame.
    """
    ball = load_asset(builtin="suzanne")
    instances = []
    for number, (path, matrix) in enumerate(placed.items()):
        matrix = matrix.copy()
        matrix[0, 3] += 2.6 * number - 1.3
        instances.append(Instance(0, matrix, f"{path}/ball"))
    first = instances[0].path
    slots = tuple(replace(slot, path=first) for slot in ball.slots)
    row = make_asset("row", (replace(ball.meshes[0], name=first),), tuple(instances), slots)
    looks, camera = {first: Look("look", (RIG_LOOKS["plastic"],))}, orbit_camera(row.center, row.radius)
    return link_lights(Scene(row, looks, lights, camera, Film((size, size))))


def row_of_three(size: int) -> Scene:
    """Return a scene of three heads in a row, in which some heads cast no shadow in some lights.

    The head in the middle is mirrored and stretched. Of three lights, the first two each exclude one head from their
    shadows. The third is in the row itself and excludes two heads.
    """
    shadow_links = [
        LightLink((("/", "expandPrims"), *((f"/{side}", "exclude") for side in sides)))
        for sides in (("Left",), ("Middle",), ("Left", "Right"))
    ]
    bright = (300.0, 200.0, 100.0)
    coloured = Shadow(True, (0.2, 0.1, 0.0), 2.0, 1.0)
    beside = RectLight(
        width=1.0, height=1.0, emission=Emission(bright, shadow_link=shadow_links[2]), position=(-3.5, 0.0, 0.5)
    )
    lights = (
        replace(near("rect"), emission=Emission(bright, shadow_link=shadow_links[0])),
        replace(near("sphere"), emission=Emission(bright, shadow_link=shadow_links[1], shadow=coloured)),
        replace(beside, axes=((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0))),
        grey(),
    )
    placed = {"/Left": np.eye(4), "/Middle": np.diag([-0.8, 1.4, 1.1, 1.0]), "/Right": np.eye(4)}
    return row_of(placed, lights, size)
