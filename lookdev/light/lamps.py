"""The lights of a rig as arrays of numbers that a shader reads.

A *lamp* is a light with a shape; the other lights of a rig are domes. Each light has a row of `FIELDS` in one array, so
that one loop of the shader serves all lamps of a kind. The shader's code depends on the kinds of lights and the
`CONTROLS` that are in the rig, not on the numbers in the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.brdf.vectors import Array, Real
from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.light.base import Light, LightCode
from lookdev.light.dome import Dome
from lookdev.light.emission import Emission, Shadow, Shaping, beam_bound, falloff_factor
from lookdev.light.kinds import LIGHT_KINDS, light_label
from lookdev.light.picture import LEVELS
from lookdev.light.placement import WORLD_AXES
from lookdev.light.rect import RectLight
from lookdev.light.shape import LampShape, greatest_cosine

SHAPES: dict[str, type[LampShape]] = {
    name: shape for kind in LIGHT_KINDS.values() for name, shape in kind.type.shapes.items()
}
"""The shapes of lamps, by their names in generated code."""

FIELDS = (
    "kind",  # index in `SHAPES`, -1 for a dome
    *("x", "y", "z"),  # position in metres; x and y are relative to the vertical axis about which the rig turns
    *(f"{axis}{i}" for axis in "xyz" for i in range(3)),  # x0 to z2: the components of the light's axes
    *("a", "b"),  # `Light.shape_numbers`
    "reach",  # metres to its farthest point
    *("red", "green", "blue"),  # radiance
    "mean",  # mean radiance of the channels, times the texture's mean and the profile's largest value
    *("turns", "camera"),  # 1 or 0: the flags of `Emission`
    *("cone", "start", "rise", "focus", "tint0", "tint1", "tint2"),  # arguments of `cone_factor` and `focus_factor`
    *("profile", "profile_scale", "angle_scale"),  # `profile` is the start of its table in `CodedRig.tables`, or -1
    *("virtual", "power", "fade", "fade_rise"),  # arguments of `falloff_factor`
    *("shadow", "limit", "zone", "gamma", "shadow0", "shadow1", "shadow2"),  # arguments of `shadow_factor`
    *("diffuse", "specular"),
    *("picture", "tree"),  # number of its texture, start of the texture's means in `CodedRig.tables`; or -1
    "spares",  # index of `Emission.shadow_excluded` in `CodedRig.shadow_excluded`
)
"""The names of the numbers in the row of a light, in their order."""

CONTROLS: Mapping[str, Callable[[Emission], object]] = {
    "shaped": lambda emission: emission.shaping,
    "profiled": lambda emission: emission.shaping and emission.shaping.profile,
    "falling": lambda emission: emission.falloff,
    "shadowed": lambda emission: emission.shadow != Shadow(),
    "still": lambda emission: not emission.turns,
    "split": lambda emission: (emission.diffuse, emission.specular) != (1.0, 1.0),
}
"""The features of an emission that have code of their own in a shader, each with a test whether an emission needs it.

``shaped`` is a beam, ``profiled`` an IES profile, ``falling`` a falloff, ``shadowed`` a shadow that is not the default,
``still`` a light that does not turn with the rig, ``split`` a factor of the diffuse or specular response.
"""


def estimate_irradiance(
    shape: LampShape, beam: Sequence[Real] | None, falloff: Sequence[Real] | None, point: Floats, normal: Floats
) -> Array:
    """Return an estimate (...) of the irradiance at points (..., 3) with normals (..., 3) from a shape of radiance 1.

    The estimate is positive wherever light from the shape arrives on the side of the normal. `beam` has the arguments
    of `beam_bound` from `cone` on; it is None if the emission is the same in all directions. `falloff` has the
    arguments of `falloff_factor` after the distance; it is None without a falloff.
    """
    axis, squared_sine = shape.cone(point)
    estimate: Array = shape.solid_angle(point) * greatest_cosine(axis, squared_sine, normal)
    if beam is not None:
        estimate = estimate * beam_bound(axis[..., 2], squared_sine, *beam)
    if falloff is not None:
        estimate = estimate * falloff_factor(np.sqrt((point * point).sum(axis=-1)), *falloff)
    return estimate


@dataclass(frozen=True)
class RigOrigin:
    """The position of a shader's origin in the world of the lights.

    `origin` is in metres. `axis` is the x and y of the vertical axis about which the rig turns.
    """

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float] = (0.0, 0.0)

    @property
    def offset(self) -> tuple[float, float, float]:
        """The vector from the axis, at height 0, to the shader's origin: a shader adds it to its points."""
        (x, y, z), (axis_x, axis_y) = self.origin, self.axis
        return x - axis_x, y - axis_y, z


@dataclass(frozen=True)
class CodedRig:
    """The lights of a rig in the order of their numbers in a shader: first the lamps, then the domes."""

    lamps: tuple[Light, ...]
    domes: tuple[Light, ...]

    @classmethod
    def from_lights(cls, lights: Sequence[Light]) -> CodedRig:
        """Return the rig of some lights; raise EnvironmentMapError if one is neither a lamp nor a dome."""
        for fault in rig_faults(lights):
            raise EnvironmentMapError(f"{fault}; backend 'exact' renders it where it is the only light")
        lamps = tuple(light for light in lights if light.shapes)
        return cls(lamps, tuple(light for light in lights if light.map_dome))

    @property
    def emissions(self) -> tuple[Emission, ...]:
        """The emission of each light."""
        return tuple(light.emission for light in (*self.lamps, *self.domes))

    @property
    def kinds(self) -> tuple[str, ...]:
        """The names of its lamps' shapes without duplicates, in the order of `SHAPES`."""
        return tuple(name for name in SHAPES if any(lamp.shape_name == name for lamp in self.lamps))

    def needs(self, control: str) -> bool:
        """Return whether the emission of a light needs one of the `CONTROLS`."""
        return any(map(CONTROLS[control], self.emissions))

    @property
    def shadow_excluded(self) -> tuple[tuple[int, ...], ...]:
        """The distinct `Emission.shadow_excluded` of its lights; () if no light's shadow excludes any parts."""
        sets = tuple(dict.fromkeys(emission.shadow_excluded for emission in self.emissions))
        return sets if any(sets) else ()

    @property
    def pictures(self) -> tuple[RectLight, ...]:
        """The lamps with a texture."""
        return tuple(lamp for lamp in self.lamps if isinstance(lamp, RectLight) and lamp.texture)

    def rows(self, rig_origin: RigOrigin) -> Floats32:
        """Return `RigOrigin.offset`, then the row of each lamp and each dome, as one array."""
        starts = dict(zip(self._tables, np.cumsum([0, *map(len, self._tables.values())]).tolist(), strict=False))
        rows = [self._row(light, starts, rig_origin) for light in (*self.lamps, *self.domes)]
        return np.array([*rig_origin.offset, *(value for row in rows for value in row)], np.float32)

    def tables(self) -> Floats32:
        """Return the numbers of profiles (`IesProfile.numbers`) and the means of textures, as one array."""
        return np.asarray(np.concatenate([*self._tables.values(), np.zeros(1)]), np.float32)

    @cached_property
    def _tables(self) -> dict[str, Floats]:
        """`IesProfile.numbers` of each profile and `RectLight.means` of each texture, by the digest of its file."""
        tables = {}
        for emission in self.emissions:
            if emission.shaping and (profile := emission.shaping.profile):
                tables[profile.table.digest] = profile.numbers
        for light in self.pictures:
            assert light.texture and light.means, "it has a texture"  # noqa: PT018
            tables[light.texture.digest] = light.means.values.ravel()
        return tables

    def _row(self, light: Light, starts: dict[str, int], rig_origin: RigOrigin) -> list[float]:
        """Return the `FIELDS` of a light; `starts` has the index of each table in `tables`, by its digest."""
        emission, color = light.emission, light.emitted_radiance
        x, y, z = light.position or (*rig_origin.axis, 0.0)
        mean_factor, texture, tree = 1.0, -1, -1
        if isinstance(light, RectLight) and light.texture and light.picture is not None:
            texture, tree = self.pictures.index(light), starts[light.texture.digest]
            mean_factor = float(light.picture.mean())
        shaping, falloff = emission.shaping or Shaping(), emission.falloff
        profile = shaping.profile
        if profile is not None:
            mean_factor *= profile.largest
        virtual, power, fade, fade_rise = falloff.numbers if falloff else (0.0, -2.0, 0.0, 0.0)
        return [
            list(SHAPES).index(light.shape_name) if light.shapes else -1,
            *(x - rig_origin.axis[0], y - rig_origin.axis[1], z),
            *(value for axis in light.axes for value in axis),
            *(*light.shape_numbers, 0.0, 0.0)[:2],
            light.reach,
            *color,
            sum(color) / 3.0 * mean_factor,
            *(emission.turns, emission.camera),
            *shaping.cone,
            max(shaping.focus, 0.0),
            *shaping.focus_tint,
            -1 if profile is None else starts[profile.table.digest],
            profile.scale if profile else 1.0,
            profile.angle_scale if profile else 0.0,
            *(virtual, power, fade, fade_rise),
            *emission.shadow.numbers,
            *emission.shadow.color,
            *(emission.diffuse, emission.specular),
            *(texture, tree),
            self.shadow_excluded.index(emission.shadow_excluded) if self.shadow_excluded else 0,
        ]


def rig_faults(lights: Sequence[Light]) -> list[str]:
    """Return a sentence for each light that cannot be part of a rig, because it is neither a lamp nor a dome."""
    return [
        f"{light_label(light, number)}: it is neither a lamp nor a dome"
        for number, light in enumerate(lights, start=1)
        if not light.shapes and light.map_dome is None
    ]


def rig_code(rig: CodedRig, *, sampled: bool, rig_origin: RigOrigin) -> LightCode:
    """Return the values for the shader of a rig; without `sampled`, domes have no tables for sampling."""
    tables, excluded_sets = rig.tables(), rig.shadow_excluded
    group_count = 1 + max((group for excluded in excluded_sets for group in excluded), default=-1)
    # The array `spared` has a flag for each set of excluded groups and each group: RIG_SPARED x RIG_GROUPS flags.
    counts = {
        "RIG_LAMPS": len(rig.lamps),
        "RIG_LIGHTS": len(rig.lamps) + len(rig.domes),
        "RIG_SIZE": 3 + len(FIELDS) * (len(rig.lamps) + len(rig.domes)),
        "RIG_TABLES": len(tables),
        "RIG_PICTURES": len(rig.pictures),
        "PICTURE_LEVELS": LEVELS,
        **{f"RIG_{name.upper()}": int(rig.needs(name)) for name in CONTROLS},
        "RIG_SEEN": int(any(lamp.emission.camera for lamp in rig.lamps)),
        "RIG_SPARED": len(excluded_sets),
        "RIG_GROUPS": group_count,
        "RIG_MARKS": group_count * len(excluded_sets),
        "RIG_LOCAL_DOMES": int(any(not dome_light.is_infinitely_far for dome_light in rig.domes)),
        "LAMP_FIELDS": len(FIELDS),
        **{f"LAMP_{name}": number for number, name in enumerate(FIELDS)},
    }
    parameters: dict[str, Content] = {}
    arrays: dict[str, Content] = {}
    for number, light in enumerate(rig.domes):
        dome = light.map_dome
        assert dome is not None, "every dome has a map"
        counts |= {f"DOME{number}_WIDTH": dome.width, f"DOME{number}_HEIGHT": dome.height}
        if not light.constant:
            files = dome.files(f"dome{number}", sampled=sampled)
            parameters |= files[0]
            arrays |= files[1]
    parameters |= {f"picture{number}": lamp.texture for number, lamp in enumerate(rig.pictures) if lamp.texture}
    lines = (*(f"#define {name} {value}" for name, value in counts.items()), *Dome.table_constants() * bool(rig.domes))
    numbers = {"lamps": rig.rows(rig_origin), "tables": tables}
    if excluded_sets:
        is_excluded = [group in excluded for excluded in excluded_sets for group in range(group_count)]
        numbers["spared"] = np.array(is_excluded, np.float32)
    return LightCode(lines, parameters, arrays, numbers)


def is_plain(light: Light) -> bool:
    """Return whether the OSL of a light's kind, if it has one, can render the light.

    The OSL of domes needs world axes and the default emission, apart from `Emission.camera`.
    """
    if light.map_dome is not light:
        return True
    emission = light.emission
    return light.axes == WORLD_AXES and emission.without_names == Emission(camera=emission.camera)
