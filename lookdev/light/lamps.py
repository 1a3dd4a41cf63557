"""Several lights as numbers: what a shader of a rig reads of each.

Lamps are the lights that are not domes. Each is a row of `FIELDS` in one array, so that one loop of the shader serves
all of a kind; the shader's code depends on which kinds and controls a rig has, not on its numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.light.base import Light, LightCode
from lookdev.light.dome import Dome
from lookdev.light.emission import Emission, Shadow, Shaping, beam_bound, falloff_factor
from lookdev.light.kinds import LIGHT_KINDS, called
from lookdev.light.picture import LEVELS
from lookdev.light.placement import WORLD_AXES
from lookdev.light.rect import RectLight
from lookdev.light.shape import greatest_cosine

Floats: TypeAlias = Any
"""An array, or a symbolic one in its place."""

SHAPES: dict[str, type[Any]] = {
    name: shape for kind in LIGHT_KINDS.values() for name, shape in kind.type.shapes.items()
}
"""Shapes of lamps, by their names in generated code; a shape's number in a row is its place here."""

FIELDS = (
    "kind",
    *("x", "y", "z"),  # position, from the axis about which the rig turns
    *(f"{axis}{i}" for axis in "xyz" for i in range(3)),  # axes
    *("a", "b"),  # the fields of its shape
    "reach",  # metres to its farthest point
    *("red", "green", "blue"),  # radiance
    "mean",  # of the radiance, of texture and profile the largest
    *("turns", "camera"),
    *("cone", "start", "rise", "focus", "tint0", "tint1", "tint2"),
    *("profile", "profile_scale", "angle_scale"),  # place in the array of tables, -1 without
    *("virtual", "power", "fade", "fade_rise"),
    *("shadow", "limit", "zone", "gamma", "shadow0", "shadow1", "shadow2"),
    *("diffuse", "specular"),
    *("picture", "tree"),  # number of its texture, and place of its `flat_tree` in the array of tables
    "spares",  # number of what it spares among `CodedRig.spared`
)
"""The numbers of a lamp, in the order of a row."""


def weight(shape: Any, beam: Any, fall: Any, place: Floats, normal: Floats) -> Floats:
    """Return an estimate (...) of the irradiance of places (..., 3) about normals, by radiance 1 of a shape.

    It is positive wherever the shape sends light to the front of a plane about the normal. `beam` and `fall` are the
    numbers of `beam_bound` and `falloff_factor`; None: the emission is the same in all directions, or has no falloff.
    """
    axis, squared_sine = shape.cone(place)
    estimate = shape.solid_angle(place) * greatest_cosine(axis, squared_sine, normal)
    if beam is not None:
        estimate = estimate * beam_bound(axis[..., 2], squared_sine, *beam)
    if fall is not None:
        estimate = estimate * falloff_factor(np.sqrt((place * place).sum(axis=-1)), *fall)
    return estimate


@dataclass(frozen=True)
class Stand:
    """Where a shader's places are, in metres of the lights' world.

    `origin` is the place that the shader has at 0, `axis` is x and y of the vertical about which a rig turns.
    """

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float] = (0.0, 0.0)

    @property
    def offset(self) -> tuple[float, float, float]:
        """What to add to a place of the shader to have it from the axis."""
        (x, y, z), (across, along) = self.origin, self.axis
        return x - across, y - along, z


@dataclass(frozen=True)
class CodedRig:
    """Lights by what a shader does with them, in the order of its numbers: lamps, then domes.

    Whether some light is `shaped`, has a `falloff`, a shadow that is not plain (`shadowed`), stands `still`, is `split`
    into diffuse and specular light, or has a profile (`profiled`).
    """

    lamps: tuple[Light, ...]
    domes: tuple[Light, ...]

    @classmethod
    def of(cls, lights: Sequence[Light]) -> CodedRig:
        """Return the rig of lights; raises EnvironmentMapError where one is neither a lamp nor a dome."""
        for fault in not_of_rigs(lights):
            raise EnvironmentMapError(f"{fault}; backend 'exact' renders it where it is the only light")
        lamps = tuple(each for each in lights if each.shapes)
        return cls(lamps, tuple(each for each in lights if each.map_dome))

    @property
    def emissions(self) -> tuple[Emission, ...]:
        """What each light sends out."""
        return tuple(each.emission for each in (*self.lamps, *self.domes))

    @property
    def kinds(self) -> tuple[str, ...]:
        """The names of its lamps' shapes, each once, in the order of `SHAPES`."""
        return tuple(name for name in SHAPES if any(each.shape_name == name for each in self.lamps))

    @property
    def shaped(self) -> bool:
        return any(each.shaping for each in self.emissions)

    @property
    def profiled(self) -> bool:
        return any(each.shaping and each.shaping.profile for each in self.emissions)

    @property
    def falling(self) -> bool:
        return any(each.falloff for each in self.emissions)

    @property
    def shadowed(self) -> bool:
        return any(each.shadow != Shadow() for each in self.emissions)

    @property
    def still(self) -> bool:
        return any(not each.turns for each in self.emissions)

    @property
    def split(self) -> bool:
        return any((each.diffuse, each.specular) != (1.0, 1.0) for each in self.emissions)

    @property
    def spared(self) -> tuple[tuple[int, ...], ...]:
        """The groups of parts that cast no shadow of some light, each set once; (): all cast those of all."""
        found = tuple(dict.fromkeys(each.spared for each in self.emissions))
        return found if any(found) else ()

    @property
    def pictures(self) -> tuple[RectLight, ...]:
        """The lamps with a texture."""
        return tuple(cast(RectLight, each) for each in self.lamps if each.shape_name == "picture")

    def rows(self, stand: Stand) -> NDArray[np.float32]:
        """Return what to add to a place of the shader, then the row of each lamp and each dome."""
        places = dict(zip(self._tables, np.cumsum([0, *map(len, self._tables.values())]).tolist(), strict=False))
        rows = [self._row(each, places, stand) for each in (*self.lamps, *self.domes)]
        return np.array([*stand.offset, *(value for row in rows for value in row)], np.float32)

    def tables(self) -> NDArray[np.float32]:
        """Return the tables of profiles, after the counts of their rows and columns, and the trees of textures."""
        return np.asarray(np.concatenate([*self._tables.values(), np.zeros(1)]), np.float32)

    @cached_property
    def _tables(self) -> dict[str, NDArray[np.float64]]:
        """Tables by the digests of the files that they are of."""
        tables = {}
        for each in self.emissions:
            if each.shaping and (profile := each.shaping.profile):
                tables[profile.table.digest] = profile.numbers
        for light in self.pictures:
            assert light.texture and light.means, "it has a texture"  # noqa: PT018
            tables[light.texture.digest] = light.means.values.ravel()
        return tables

    def _row(self, light: Light, places: dict[str, int], stand: Stand) -> list[float]:
        emission, color = light.emission, light.sent
        x, y, z = light.position or (*stand.axis, 0.0)
        brightest, texture, tree = 1.0, -1, -1
        if light in self.pictures:
            texture = self.pictures.index(light)
            picture = self.pictures[texture]
            assert picture.texture is not None and picture.picture is not None, "it has a texture"  # noqa: PT018
            brightest, tree = float(picture.picture.mean()), places[picture.texture.digest]
        shaping, falloff = emission.shaping or Shaping(), emission.falloff
        profile = shaping.profile
        if profile is not None:
            brightest *= profile.largest
        virtual, power, fade, fade_rise = falloff.numbers if falloff else (0.0, -2.0, 0.0, 0.0)
        return [
            list(SHAPES).index(light.shape_name) if light.shapes else -1,
            *(x - stand.axis[0], y - stand.axis[1], z),
            *(value for axis in light.axes for value in axis),
            *(*light.shape_numbers, 0.0, 0.0)[:2],
            light.reach,
            *color,
            sum(color) / 3.0 * brightest,
            *(emission.turns, emission.camera),
            *shaping.cone,
            max(shaping.focus, 0.0),
            *shaping.focus_tint,
            -1 if profile is None else places[profile.table.digest],
            profile.scale if profile else 1.0,
            profile.angle_scale if profile else 0.0,
            *(virtual, power, fade, fade_rise),
            *emission.shadow.numbers,
            *emission.shadow.color,
            *(emission.diffuse, emission.specular),
            *(texture, tree),
            self.spared.index(emission.spared) if self.spared else 0,
        ]


def not_of_rigs(lights: Sequence[Light]) -> list[str]:
    """Return which lights no shader of a rig shows, a sentence for each: they are neither lamps nor domes."""
    return [
        f"{called(light, number)}: it is neither a lamp nor a dome"
        for number, light in enumerate(lights, start=1)
        if not light.shapes and light.map_dome is None
    ]


def rig_code(rig: CodedRig, *, sampled: bool, stand: Stand) -> LightCode:
    """Return the values for the shader of a rig."""
    tables, spared = rig.tables(), rig.spared
    groups = 1 + max((group for each in spared for group in each), default=-1)
    counts = {
        "RIG_LAMPS": len(rig.lamps),
        "RIG_LIGHTS": len(rig.lamps) + len(rig.domes),
        "RIG_SIZE": 3 + len(FIELDS) * (len(rig.lamps) + len(rig.domes)),
        "RIG_TABLES": len(tables),
        "RIG_PICTURES": len(rig.pictures),
        "PICTURE_LEVELS": LEVELS,
        "RIG_SHAPED": int(rig.shaped),
        "RIG_PROFILED": int(rig.profiled),
        "RIG_FALLING": int(rig.falling),
        "RIG_SHADOWED": int(rig.shadowed),
        "RIG_STILL": int(rig.still),
        "RIG_SPLIT": int(rig.split),
        "RIG_SEEN": int(any(each.emission.camera for each in rig.lamps)),
        "RIG_SPARED": len(spared),
        "RIG_GROUPS": groups,
        "RIG_MARKS": groups * len(spared),
        "RIG_LOCAL_DOMES": int(any(not each.far for each in rig.domes)),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    parameters: dict[str, Content] = {}
    arrays: dict[str, Content] = {}
    for number, light in enumerate(rig.domes):
        dome = light.map_dome
        assert dome is not None, "it shows a map"
        counts |= {f"DOME{number}_WIDTH": dome.width, f"DOME{number}_HEIGHT": dome.height}
        if not light.constant:
            files = dome.files(f"dome{number}", sampled=sampled)
            parameters |= files[0]
            arrays |= files[1]
    parameters |= {f"picture{number}": each.texture for number, each in enumerate(rig.pictures) if each.texture}
    lines = (*(f"#define {name} {value}" for name, value in counts.items()), *Dome.table_constants() * bool(rig.domes))
    numbers = {"lamps": rig.rows(stand), "tables": tables}
    if spared:
        numbers["spared"] = np.array([group in each for each in spared for group in range(groups)], np.float32)
    return LightCode(lines, parameters, arrays, numbers)


def is_plain(light: Light) -> bool:
    """Return whether a light is a dome as its map is: the OSL of its kind shows it."""
    if light.map_dome is not light:
        return True
    emission = light.emission
    return light.axes == WORLD_AXES and emission.unnamed == Emission(camera=emission.camera)
