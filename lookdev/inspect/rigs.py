"""Describes the lights of a rig, for `lookdev inspect`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from lookdev.light import Emission
from lookdev.light.emission import LightLink
from lookdev.light.placement import Vector, vector
from lookdev.light.rig import LightRig, RigLight
from lookdev.safe_text import align_columns


@dataclass(frozen=True)
class InspectedLight:
    """The description of a light.

    - path, kind: the path of the prim, and the kind of the light in `lookdev.light.kinds`, such as "rect"
    - position: None for an infinitely distant light
    - shines: the direction of the light's axis, or None for a light that emits to all sides
    - sizes: lengths or angles, by the names of the light's fields
    - value: in linear Rec.709, the radiance in nits or, if `unit` is ``"lux"``, the irradiance on a plane perpendicular
      to the light; it includes the mean of the light's image, but not the light's shaping
    - image: the file of the image, or ""
    - group: the light group
    - turns: whether the light rotates with a turntable of the kind `lighting`
    - camera: whether the camera sees the light
    - diffuse, specular: multipliers of diffuse and specular reflections
    - shaping, shadow, falloff: phrases that describe settings other than the defaults
    - light_link, shadow_link: the rules of `lookdev.light.emission.LightLink`, pairs of a path and a rule
    """

    path: str
    kind: str
    position: Vector | None
    shines: Vector | None
    sizes: dict[str, float]
    value: Vector
    unit: str
    image: str
    group: str
    turns: bool
    camera: bool
    diffuse: float
    specular: float
    shaping: tuple[str, ...]
    shadow: tuple[str, ...]
    falloff: tuple[str, ...]
    light_link: tuple[tuple[str, str], ...]
    shadow_link: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class InspectedRig:
    """The description of a rig. Lengths are in metres or, if `fit`, in radii of the asset's bounding sphere."""

    file: str
    fit: bool
    lights: tuple[InspectedLight, ...]
    notes: tuple[str, ...]

    def data(self) -> dict[str, object]:
        """Return all fields for JSON."""
        return asdict(self)

    def text(self) -> str:
        """Return a line for each light, followed by its settings other than the defaults, and then the notes."""
        unit = "in radii of the asset's bounding sphere, about its centre" if self.fit else "in metres, z up"
        count = f"{len(self.lights)} light{'s' * (len(self.lights) != 1)}"
        lines = [f"{self.file}: a rig of {count}, {unit}", ""]
        for light, line in zip(self.lights, align_columns(list(map(_light_row, self.lights))), strict=True):
            lines += [line, *(f"    {detail}" for detail in _light_details(light))]
        if self.notes:
            lines += ["", "notes", *(f"  {note}" for note in self.notes)]
        return "\n".join(lines)


def inspect_rig(rig: LightRig) -> InspectedRig:
    """Return the inspection of a rig."""
    return InspectedRig(rig.file, rig.fit, tuple(map(_inspect_light, rig.rig_lights)), rig.notes)


def _inspect_light(rig_light: RigLight) -> InspectedLight:
    """Return the description of a light."""
    light, emission = rig_light.light, rig_light.light.emission
    value = np.array(emission.color) * np.array(rig_light.mean)
    irradiance = light.irradiance_per_nit
    r, g, b = (value if irradiance is None else value * irradiance).tolist()
    # A light that emits to all sides has an axis only if it has shaping.
    one_sided = light.one_sided or emission.shaping is not None
    return InspectedLight(
        path=rig_light.path,
        kind=light.kind,
        position=light.position,
        shines=vector(0.0 - np.array(light.axes[2])) if one_sided else None,
        sizes=dict(light.sizes),
        value=(r, g, b),
        unit="nits" if irradiance is None else "lux",
        image=rig_light.image,
        **{name: getattr(emission, name) for name in ("group", "turns", "camera", "diffuse", "specular")},
        shaping=_describe_shaping(emission),
        shadow=_describe_shadow(emission),
        falloff=_describe_falloff(emission),
        light_link=_link_rules(emission.light_link),
        shadow_link=_link_rules(emission.shadow_link),
    )


def _describe_shaping(emission: Emission) -> tuple[str, ...]:
    """Return phrases about a light's cone, focus and IES profile."""
    shaping = emission.shaping
    if shaping is None:
        return ()
    phrases = [f"cone {shaping.cone_angle:g} degrees, softness {shaping.cone_softness:g}"]
    if shaping.focus > 0.0:
        phrases.append(f"focus {shaping.focus:g}, tint {_format_vector(shaping.focus_tint)}")
    if shaping.profile:
        phrases.append(f"IES profile, angle scale {shaping.profile.angle_scale:g}")
    return tuple(phrases)


def _describe_shadow(emission: Emission) -> tuple[str, ...]:
    """Return phrases about a light's shadow; none for an unlimited black shadow."""
    shadow = emission.shadow
    phrases = [] if shadow.enable else ["none"]
    if any(shadow.color):
        phrases.append(f"colour {_format_vector(shadow.color)}")
    if shadow.distance >= 0.0:
        falloff = f", falloff {shadow.falloff:.4g}, gamma {shadow.falloff_gamma:g}" if shadow.falloff > 0.0 else ""
        phrases.append(f"up to {shadow.distance:.4g}{falloff}")
    return tuple(phrases)


def _describe_falloff(emission: Emission) -> tuple[str, ...]:
    """Return phrases about a light's falloff with distance; none for the physical falloff."""
    falloff = emission.falloff
    if falloff is None:
        return ()
    phrases = [f"exponent {falloff.exponent:g}"]
    if falloff.virtual_distance:
        phrases.append(f"virtual distance {falloff.virtual_distance:.4g}")
    if falloff.end is not None:
        phrases.append(f"fades from {falloff.start:.4g} to {falloff.end:.4g}")
    return tuple(phrases)


def _link_rules(link: LightLink | None) -> tuple[tuple[str, str], ...]:
    """Return the rules of a link; there are none without a link, which means that the light is linked to all parts."""
    return link.rules if link else ()


def _light_row(light: InspectedLight) -> tuple[str, ...]:
    """Return the cells of a light's line."""
    sizes = " x ".join(f"{light.sizes[name]:.4g}" for name in ("width", "height") if name in light.sizes)
    sizes = sizes or ", ".join(f"{name} {size:.4g}" for name, size in light.sizes.items())
    position = "" if light.position is None else f"at {_format_vector(light.position)}"
    direction = "" if light.shines is None else f"towards {_format_vector(light.shines)}"
    return (
        light.path,
        light.kind.replace("_", " "),
        sizes,
        position,
        direction,
        f"{_format_vector(light.value)} {light.unit}",
        f"group {light.group}" if light.group != light.path.rpartition("/")[2] else "",
        "" if light.turns else "does not turn",
    )


def _light_details(light: InspectedLight) -> Iterator[str]:
    """Yield the lines below a light's line."""
    if light.image:
        yield f"image {light.image}; its mean is in the radiance above"
    for name in ("shaping", "shadow", "falloff"):
        if phrases := getattr(light, name):
            yield f"{name}: {'; '.join(phrases)}"
    for name in ("diffuse", "specular"):
        if (factor := getattr(light, name)) != 1.0:
            yield f"{name} times {factor:g}"
    for name, rules in (("shines on", light.light_link), ("shadows of", light.shadow_link)):
        if rules:
            yield f"{name}: {', '.join(f'{path} ({rule})' for path, rule in rules)}"
    if light.camera:
        yield "seen by the camera"


def _format_vector(values: Vector) -> str:
    """Return a vector as text with four significant digits."""
    # A component that is only a rounding error, relative to the largest, is printed as 0.
    threshold = 1e-9 * max(map(abs, values))
    return f"({', '.join(f'{value if abs(value) > threshold else 0.0:.4g}' for value in values)})"
