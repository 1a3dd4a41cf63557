"""Rectangle light: `UsdLuxRectLight`, with or without a texture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.table import NumberTable
from lookdev.brdf.vectors import Real
from lookdev.cache import Content
from lookdev.light import spherical_rectangle as spherical
from lookdev.light.base import LightKind
from lookdev.light.dome.environment import EnvironmentMap, map_in_space, read_exr
from lookdev.light.emission import WHITE
from lookdev.light.picture import cell_pdf, draw_cell, flatten_pyramid, look_up, mean_pyramid, prepare_texture
from lookdev.light.placed import PlacedLight
from lookdev.light.shape import FAR, LampShape, cone_about
from lookdev.light.usd import PlacedPrim, UsdLight, UsdLightShape
from lookdev.space import Space


@dataclass(frozen=True)
class RectangleShape:
    """The `LampShape` of a rectangle with sides along x and y."""

    width: Real
    height: Real

    def distance(self, point: Floats, direction: Floats) -> Floats:
        return self._intersect(point, direction)[0]

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        distance, hit = self._intersect(point, direction)
        return np.where(distance < FAR, spherical.density(self._project(point), hit), 0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        return spherical.directions_to_points(point, spherical.draw(self._project(point), u))

    def solid_angle(self, point: Floats) -> Floats:
        return spherical.approximate_solid_angle(point, self.width, self.height, self.width * self.height)

    def cone(self, point: Floats) -> tuple[Floats, Floats]:
        return cone_about(point, np.sqrt(self.width * self.width + self.height * self.height) / 2)

    def _intersect(self, point: Floats, direction: Floats) -> tuple[Floats, spherical.RectanglePoint]:
        return spherical.intersect_rectangle(point, direction, self.width, self.height)

    def _project(self, point: Floats) -> spherical.SphericalRectangle:
        return spherical.project_part(point, self.width, self.height)


@dataclass(frozen=True)
class TexturedRectangle(RectangleShape):
    """The `LampShape` of a rectangle whose directions are drawn in proportion to a texture.

    `means` is a column of numbers with the texture's `flatten_pyramid` from row `start` on.
    """

    means: NumberTable
    start: Real = 0.0

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        distance, hit = self._intersect(point, direction)
        pdf = cell_pdf(self.means, self.start, point, self.width, self.height, hit)
        return np.where(distance < FAR, pdf, 0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        target = draw_cell(self.means, self.start, point, self.width, self.height, u)
        return spherical.directions_to_points(point, target)


@dataclass(frozen=True, kw_only=True)
class RectLight(PlacedLight):
    """A rectangle, of `width` along its x and `height` along its y in metres, that emits from its -z side.

    `texture` multiplies the emission. It is an EXR of R, G, B, linear Rec.709, written by `prepare_texture`. The first
    texel of its top row is at (+x, +y), so that the texture is upright and not mirrored when seen from the front.
    """

    kind = "rect"
    one_sided = True
    shapes: ClassVar[Mapping[str, type[LampShape]]] = {"rect": RectangleShape, "picture": RectangleShape}
    example_sizes: ClassVar[Mapping[str, float]] = {"width": 1.2, "height": 0.8}

    width: float
    height: float
    texture: Content | None = None

    @property
    def shape(self) -> LampShape:
        return super().shape if self.means is None else TexturedRectangle(self.width, self.height, self.means)

    @property
    def shape_name(self) -> str:
        return "picture" if self.texture else "rect"

    @property
    def reach(self) -> float:
        """Metres from the centre to a corner."""
        return math.hypot(self.width, self.height) / 2.0

    def _convert(self, space: Space) -> RectLight:
        if self.texture is None or self.picture is None:
            return super()._convert(space)
        # The texture times the colour is converted as a whole: the new texture includes the colour.
        texture = prepare_texture(map_in_space(self.picture, self.emission.color, self.texture.digest, space))
        return replace(self, texture=texture, emission=replace(self.emission.in_space(space), color=WHITE.color))

    @property
    def native_images(self) -> tuple[Content, ...]:
        return (self.texture,) if self.texture else ()

    @property
    def mitsuba_shape(self) -> tuple[str, Floats] | None:
        return None if self.texture else ("rectangle", np.diag([self.width / 2.0, self.height / 2.0, 1.0, 1.0]))

    @property
    def size_factor(self) -> float:
        """The area in square metres."""
        return self.width * self.height

    @cached_property
    def picture(self) -> Floats | None:
        """The texture (H, W, 3), row 0 at +y, column 0 at +x; raises EnvironmentMapError if its file is broken."""
        return None if self.texture is None else read_exr(self.texture.path, "RGB").astype(np.float64)

    @cached_property
    def means(self) -> NumberTable | None:
        """The `flatten_pyramid` of the texture as a column, for sampling."""
        return None if self.picture is None else NumberTable(flatten_pyramid(mean_pyramid(self.picture))[:, None])

    def _radiance_factor(self, point: Floats, direction: Floats) -> Floats | float:
        if self.picture is None:
            return 1.0
        # Column 0 of the texture is at +x, where s is 1, and row 0 is at +y, where t is 1.
        _, hit = spherical.intersect_rectangle(point, direction, self.width, self.height)
        return np.asarray(look_up(self.picture, 1.0 - hit.s, 1.0 - hit.t))


def _read(prim: PlacedPrim) -> UsdLightShape:
    width, height = (prim.length(name, prim.scale[i]) for i, name in enumerate(("width", "height")))
    light = RectLight(width=width, height=height, position=prim.position, axes=prim.axes)
    image, space = prim.image

    def make(picture: EnvironmentMap | None) -> RectLight:
        return light if picture is None else replace(light, texture=prepare_texture(picture))

    return UsdLightShape(make, light.size_factor, lengths=light.shape_numbers, image=image, space=space)


RECT = LightKind(RectLight, RectLight.example, {"RectLight": UsdLight(_read)})
