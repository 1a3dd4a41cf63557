"""The emission of a light of any kind: colour, beam shape, shadow, falloff, and links to the parts of an asset.

Names and formulas are those of UsdLux: `UsdLuxLightAPI`, `UsdLuxShapingAPI` and `UsdLuxShadowAPI`, documented in
``pxr/pluginfo/usdLux/resources/usdLux/schema.usda`` of usd-core 26.11. Radiance is in nits: radiance 1 gives a pixel
value of 1. `Falloff` is neither physical nor part of UsdLux. It serves the aim of section 6.2 of Burley, "Physically
Based Shading at Disney", 2012.

In this file, directions (..., 3) are unit vectors from a shading point towards the light, in the light's own space.
The light emits in the opposite direction, and its axis is -z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Real
from lookdev.errors import EnvironmentMapError
from lookdev.light.ies import IesProfile
from lookdev.light.placement import vector
from lookdev.light.shape import FAR
from lookdev.space import Color, Space, to_space

DEGREES = 180.0 / math.pi

_MIN_DISTANCE = 1e-6  # metres: falloffs clamp distances to it, so that no exponent divides by 0


def slope(start: float, end: float) -> float:
    """Return the `rise` of a `smooth_step` from `start` to `end`.

    If `end` is not greater than `start`, `rise` is 0, and the step is 0 everywhere.
    """
    return 1.0 / (end - start) if end > start else 0.0


def smooth_step(value: Real, start: Real, rise: Real) -> Floats:
    """Return 0 up to `start`, 1 from ``start + 1 / rise`` on, and a smooth cubic polynomial in between."""
    t = np.clip((value - start) * rise, 0.0, 1.0)
    step: Floats = t * t * (3.0 - 2.0 * t)
    return step


def off_axis(direction: Floats) -> Floats:
    """Return the angle (...) in radians between the emission and the light's axis, for directions (..., 3)."""
    x, y, z = np.moveaxis(direction, -1, 0)
    angle: Floats = np.arctan2(np.sqrt(x * x + y * y), z)
    return angle


def azimuth(direction: Floats) -> Floats:
    """Return the azimuth (...) of the emission about z, from x towards y, in degrees from 0 to 360."""
    x, y = direction[..., 0], direction[..., 1]
    turns = np.arctan2(-y, -x) / (2.0 * math.pi)  # revolutions
    angle: Floats = 360.0 * (turns - np.floor(turns))
    return angle


# UsdLuxShapingAPI: inputs:shaping:cone:angle and inputs:shaping:cone:softness.
def cone_factor(angle: Floats, cone: Real, start: Real, rise: Real) -> Floats:
    """Return the factor (...) of the radiance within the cone of a `Shaping`, 0 outside it.

    `angle` (...) is the angle between the emission and the light's axis, `cone` the half angle of the cone, both in
    radians. From the angle `start` on, the factor falls smoothly to 0 at `cone`; `rise` is the `slope` from `start` to
    `cone`.
    """
    return np.where(angle <= cone, 1.0 - smooth_step(angle, start, rise), 0.0)


def beam_bound(
    cosine: Floats, squared_sine: Floats, cone: Real, start: Real, rise: Real, focus: Real, tint: Real
) -> Floats:
    """Return an upper bound (...) of the factor of `Shaping`, without its profile, over a bundle of directions.

    It bounds the mean over channels. The bundle has all directions within an angle of a central direction. `cosine`
    (...) is the cosine of the angle between the emission along the central direction and the light's axis.
    `squared_sine` (...) is the squared sine of the bundle's half angle; 1 means all directions. `cone`, `start` and
    `rise` are arguments of `cone_factor`. `focus` is an argument of `focus_factor`, and so is `tint`, as the mean of
    its channels.
    """
    angle = np.arctan2(np.sqrt(np.maximum(1 - cosine * cosine, 0)), cosine)
    spread = np.where(squared_sine < 1, np.arctan2(np.sqrt(squared_sine), np.sqrt(1 - squared_sine)), math.pi)
    nearest, farthest = np.maximum(angle - spread, 0), np.minimum(angle + spread, math.pi)
    focused = np.maximum(np.maximum(np.cos(nearest), -np.cos(farthest)), 0) ** focus
    bound: Floats = cone_factor(nearest, cone, start, rise) * (focused + (1 - focused) * tint)
    return bound


# UsdLuxShapingAPI: inputs:shaping:focus and inputs:shaping:focusTint.
def focus_factor(cosine: Floats, focus: Real, tint: Real) -> Floats:
    """Return the factor (..., 3) of the radiance by ``focus``; at right angles to the axis it is `tint` (3,).

    `cosine` (...) is the cosine of the emission's angle off the axis; only its absolute value counts.
    """
    focused: Floats = np.expand_dims(np.absolute(cosine) ** focus, -1)
    return focused + (1.0 - focused) * tint


def check_number(name: str, value: float, *, least: float = -math.inf, above: float = -math.inf) -> float:
    """Return `value`; raise EnvironmentMapError unless it is finite, at least `least` and greater than `above`."""
    if not (math.isfinite(value) and value >= least and value > above):
        least_text = f"at least {least:g}" if least > -math.inf else "finite"
        right = f"more than {above:g}" if above > -math.inf else least_text
        raise EnvironmentMapError(f"{name} {value:g}: a number that is {right} would be right")
    return value


def check_color(name: str, value: Sequence[float]) -> None:
    """Raise EnvironmentMapError unless all channels are finite and not negative."""
    if not all(math.isfinite(channel) and channel >= 0.0 for channel in value):
        channels = ", ".join(f"{channel:g}" for channel in value)
        raise EnvironmentMapError(f"{name} ({channels}): finite channels, none negative, would be right")


@dataclass(frozen=True)
class Shaping:
    """The beam of a light: `UsdLuxShapingAPI`. Angles are in degrees off the light's axis.

    The defaults change nothing. UsdLux's own default of `cone_angle`, where a prim has the schema, is 90.
    """

    cone_angle: float = 180.0
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: Color = (0.0, 0.0, 0.0)
    profile: IesProfile | None = None

    def __post_init__(self) -> None:
        check_number("cone angle", self.cone_angle, least=0.0)
        check_number("cone softness", self.cone_softness)
        check_number("focus", self.focus)
        check_color("focus tint", self.focus_tint)

    def factor(self, direction: Floats) -> Floats:
        """Return the factor (..., 3) of the radiance for directions (..., 3)."""
        angle = off_axis(direction)
        factor = cone_factor(angle, *self.cone)
        if self.profile:
            factor = factor * self.profile.factor(DEGREES * angle, azimuth(direction))
        return factor[..., None] * focus_factor(direction[..., 2], max(self.focus, 0.0), np.array(self.focus_tint))

    @property
    def cone(self) -> tuple[float, float, float]:
        """The arguments `cone`, `start` and `rise` of `cone_factor`."""
        cone = math.radians(self.cone_angle)
        start = cone * (1.0 - min(max(self.cone_softness, 0.0), 1.0))
        # Computed angles may exceed pi by rounding; the limit 4.0 includes all of them.
        return cone if self.cone_angle < 180.0 else 4.0, start, slope(start, cone)


@dataclass(frozen=True)
class Shadow:
    """The shadow controls of a light: `UsdLuxShadowAPI`.

    `distance` and `falloff` are in metres: `distance` is measured from the shading point to the occluder, `falloff` is
    the length over which the shadow fades before that distance. A negative `distance` means no limit, a negative
    `falloff` no fading.
    """

    enable: bool = True
    color: Color = (0.0, 0.0, 0.0)
    distance: float = -1.0
    falloff: float = -1.0
    falloff_gamma: float = 1.0

    def __post_init__(self) -> None:
        check_color("shadow colour", self.color)
        for name in ("distance", "falloff"):
            check_number(f"shadow {name}", getattr(self, name))
        check_number("shadow falloff gamma", self.falloff_gamma, least=0.0)

    def transmittance(self, distance: Floats) -> Floats:
        """Return the share (..., 3) of the light that passes occluders at distances (...)."""
        return shadow_factor(distance, *self.numbers, np.array(self.color))

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """The arguments `enable`, `limit`, `zone` and `gamma` of `shadow_factor`."""
        limit = self.distance if self.distance >= 0.0 else math.inf
        return float(self.enable), min(limit, FAR), max(min(self.falloff, self.distance), 0.0), self.falloff_gamma


# UsdLuxShadowAPI: inputs:shadow:falloffGamma. The exponent applies to the linear fraction of the zone.
def shadow_factor(distance: Real, enable: Real, limit: Real, zone: Real, gamma: Real, color: Real) -> Floats:
    """Return the share (..., 3) of the light that passes occluders at distances (...).

    Occluders beyond `limit` metres cast no shadow. The shadow fades over the last `zone` metres before the limit, with
    the exponent `gamma`. The shadow has a `color` (3,). `enable` is 1, or 0 for no shadow.
    """
    faded = np.clip((limit - distance) / np.where(zone > 0.0, zone, 1.0), 0.0, 1.0) ** gamma
    strength = enable * np.where(zone > 0.0, faded, np.where(distance <= limit, 1.0, 0.0))
    return 1.0 - np.expand_dims(strength, -1) * (1.0 - color)


_BLACK_SHADOW = Shadow()  # the default: enabled, black and without a limit


@dataclass(frozen=True)
class Falloff:
    """The falloff of a light with the distance d in metres from its position; it is not physical.

    The irradiance from a small light is its intensity times ``(d + virtual_distance) ** -exponent``, instead of
    ``d ** -2``. The irradiance fades smoothly to 0 from distance `start` to `end`. If `end` is None, it does not fade.
    """

    virtual_distance: float = 0.0
    exponent: float = 2.0
    start: float = 0.0
    end: float | None = None

    def __post_init__(self) -> None:
        check_number("virtual distance", self.virtual_distance, least=0.0)
        check_number("falloff exponent", self.exponent, least=0.0)
        check_number("falloff start", self.start, least=0.0)
        if self.end is not None and check_number("falloff end", self.end) <= self.start:
            raise EnvironmentMapError(f"falloff end {self.end:g}: more than its start, {self.start:g}, would be right")

    def factor(self, distance: Floats) -> Floats:
        """Return the factor (...) of the radiance at distances (...) from the light's position."""
        return falloff_factor(distance, *self.numbers)

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """The arguments `virtual`, `power`, `start` and `rise` of `falloff_factor`."""
        rise = 0.0 if self.end is None else slope(self.start, self.end)
        return self.virtual_distance, -self.exponent, self.start, rise


def falloff_factor(distance: Real, virtual: Real, power: Real, start: Real, rise: Real) -> Floats:
    """Return the factor (...) of the radiance at distances (...) for the fields of a `Falloff`.

    `virtual` is the virtual distance, `power` is minus the exponent. The light fades from `start` on, and `rise` is the
    `slope` from `start` to the end. The factor contains d^2, because the solid angle already falls with d^-2.
    """
    nearest = np.maximum(distance, _MIN_DISTANCE)
    factor: Floats = nearest * nearest * (nearest + virtual) ** power * (1.0 - smooth_step(distance, start, rise))
    return factor


MAX_SHADOW_GROUPS = 80
"""The maximum number of groups of parts that shadow links can make, without the group that casts all shadows.

The parts of a group cast the shadows of the same lights (`lookdev.scene.scene.link_lights`).
"""


@dataclass(frozen=True)
class LightLink:
    """The parts of an asset that a light illuminates, or the parts that cast its shadow.

    `rules` are sorted pairs of a prim path and a rule: ``"expandPrims"``, ``"explicitOnly"`` or ``"exclude"``, as in
    `UsdCollectionMembershipQuery`. The paths are compared with those of parts, `lookdev.scene.parts.Part.path`.
    """

    rules: tuple[tuple[str, str], ...]

    @cached_property
    def _rules(self) -> Mapping[str, str]:
        return dict(self.rules)

    def includes(self, path: str) -> bool:
        """Return whether the part at a path is linked: by its own rule, else by its nearest ancestor's rule.

        A rule ``"explicitOnly"`` does not apply to descendants.
        """
        if (rule := self._rules.get(path)) is not None:
            return rule != "exclude"
        while path.strip("/"):
            path = path.rpartition("/")[0] or "/"
            if (rule := self._rules.get(path)) in ("expandPrims", "exclude"):
                return rule == "expandPrims"
        return False


@dataclass(frozen=True)
class Emission:
    """The emission of a light.

    Parameters
    ----------
    color
        Radiance in nits, linear Rec.709, before `shaping`; `emitted_color` computes it.
    diffuse, specular
        Factors of the diffuse and the specular response of a surface to the light.
    shaping
        The shape of its beam. None if the radiance is the same in all directions.
    shadow
        The controls of its shadow.
    falloff
        Its unphysical falloff. None if the radiance does not depend on the distance.
    turns
        Whether the light turns in a turntable of kind ``lighting``.
    camera
        Whether the camera sees it.
    group
        The name of its light group.
    path
        The path of its prim, for messages; "" if it has no prim.
    light_link, shadow_link
        The parts of the asset that it illuminates, and those that cast its shadow; None for all parts.
    shadow_excluded
        The numbers of the groups of parts that do not cast its shadow. `lookdev.scene.scene` groups the parts and
        computes the numbers from `shadow_link`; renderers read them.
    """

    color: Color = (1.0, 1.0, 1.0)
    diffuse: float = 1.0
    specular: float = 1.0
    shaping: Shaping | None = None
    shadow: Shadow = _BLACK_SHADOW
    falloff: Falloff | None = None
    turns: bool = True
    camera: bool = False
    group: str = ""
    path: str = ""
    light_link: LightLink | None = None
    shadow_link: LightLink | None = None
    shadow_excluded: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check_color("colour times intensity", self.color)
        check_number("diffuse multiplier", self.diffuse, least=0.0)
        check_number("specular multiplier", self.specular, least=0.0)

    @property
    def without_names(self) -> Emission:
        """The emission with defaults for the fields on which no pixel depends: `group`, `path` and the two links."""
        return replace(self, group="", path="", light_link=None, shadow_link=None)

    def scale_lengths(self, scale: float) -> Emission:
        """Return the emission with distances `scale` times as long."""
        shadow, falloff = self.shadow, self.falloff
        if shadow.distance >= 0.0:
            # A negative falloff stays negative, and means no fading.
            shadow = replace(shadow, distance=scale * shadow.distance, falloff=scale * shadow.falloff)
        if falloff is None:
            return replace(self, shadow=shadow)
        # `Falloff.factor` has the unit metre^(2 - exponent); the colour compensates the change of the factor.
        factor = scale ** (falloff.exponent - 2.0)
        r, g, b = (factor * channel for channel in self.color)
        end = None if falloff.end is None else scale * falloff.end
        virtual, start = scale * falloff.virtual_distance, scale * falloff.start
        longer = replace(falloff, virtual_distance=virtual, start=start, end=end)
        return replace(self, color=(r, g, b), shadow=shadow, falloff=longer)

    def in_space(self, space: Space) -> Emission:
        """Convert the emission from linear Rec.709 to a colour space, also the shadow's colour and the focus tint."""
        shadow = replace(self.shadow, color=_filter_in_space(self.color, self.shadow.color, space))
        shaping = self.shaping
        if shaping is not None:
            shaping = replace(shaping, focus_tint=_filter_in_space(self.color, shaping.focus_tint, space))
        return replace(self, color=vector(to_space(self.color, space)), shaping=shaping, shadow=shadow)

    def radiance_towards(self, direction: Floats) -> Floats:
        """Return the radiance (..., 3) for directions (..., 3), without falloff."""
        color = np.array(self.color)
        return color * (self.shaping.factor(direction) if self.shaping else np.ones((*direction.shape[:-1], 3)))

    def falloff_factor(self, distance: Floats) -> Floats:
        """Return the factor (...) of the radiance at distances (...) from the light's position."""
        return self.falloff.factor(distance) if self.falloff else np.ones_like(distance)


WHITE = Emission()
"""Radiance 1 in all directions."""


def _filter_in_space(light: Color, factor: Color, space: Space) -> Color:
    """Return the factor that changes a light's colour in a space as `factor` does in Rec.709."""
    if len({*factor}) == 1:
        return factor
    before = to_space(light, space)
    after = to_space(np.array(light) * np.array(factor), space)
    return vector(np.divide(after, before, out=np.zeros(3), where=before > 0.0))


def emitted_color(
    color: Sequence[float],
    *,
    intensity: float = 1.0,
    exposure: float = 0.0,
    temperature: Sequence[float] = (1.0, 1.0, 1.0),
    size: float = 1.0,
) -> Color:
    """Return an `Emission.color`, computed from the inputs of a light as `UsdLuxLightAPI` defines.

    The inputs are intensity, exposure, normalize, color, enableColorTemperature and colorTemperature. `temperature` is
    the value of `UsdLux.BlackbodyTemperatureAsRgb`, or 1 if the colour temperature is not enabled. `size` is the
    light's `size_factor`, or 1 if its power is not normalized.
    """
    check_number("intensity", intensity, least=0.0)
    check_number("exposure", exposure)
    # An overflow gives infinity, which Emission rejects.
    scale = intensity * math.pow(2.0, min(exposure, 1000.0)) / size
    r, g, b = (scale * a * t for a, t in zip(color, temperature, strict=True))
    return r, g, b
