"""Reader of a light prim's emission: `UsdLuxLightAPI`, its shaping, shadow and links, and ``lookdev:falloff``."""

from __future__ import annotations

from pxr import Usd, UsdLux

from lookdev.light.emission import Emission, Falloff, LightLink, Shadow, Shaping, emitted_color
from lookdev.light.ies import load_profile
from lookdev.light.rig.attributes import SHAPING, LightPrim, RigReport, schema_names
from lookdev.light.usd import FALLOFF_ATTRIBUTES
from lookdev.stage import clean_usd_message

MIN_KELVIN, MAX_KELVIN = 1000.0, 10000.0
"""The range in kelvin of inputs:colorTemperature; UsdLux's function clamps other values to it.

UsdLuxLightAPI: "The valid range is from 1000 to 10000".
"""


def read_emission(light: LightPrim, size: float, unit: float, report: RigReport) -> Emission:
    """Return the emission of a light.

    `size` is UsdLux's divisor of the radiance, which applies if the power is normalized. `unit` is the stage's unit of
    length in metres. Raises EnvironmentMapError if values contradict each other.
    """
    color = light.color("inputs:color")
    scale = {"intensity": light.number("inputs:intensity", least=0.0), "exposure": light.number("inputs:exposure")}
    temperature = _temperature(light) if light.flag("inputs:enableColorTemperature") else (1.0, 1.0, 1.0)
    normalized = size if light.flag("inputs:normalize") else 1.0
    return Emission(
        emitted_color(color, **scale, temperature=temperature, size=normalized),
        diffuse=light.number("inputs:diffuse", least=0.0),
        specular=light.number("inputs:specular", least=0.0),
        shaping=_shaping(light, report) if _is_shaped(light) else None,
        shadow=_shadow(light, unit) if light.prim.HasAPI(UsdLux.ShadowAPI) else Shadow(),
        falloff=_falloff(light, unit) if any(light.has(f"lookdev:{name}") for name in FALLOFF_ATTRIBUTES) else None,
        turns=light.flag("lookdev:turns", default=True),
        camera=light.flag("lookdev:camera"),
        group=light.text("lookdev:lightGroup", default=light.prim.GetName()),
        path=str(light.path),
        light_link=_link(light, "lightLink"),
        shadow_link=_link(light, "shadowLink"),
    )


def _temperature(light: LightPrim) -> tuple[float, ...]:
    """Return the colour of a light's colour temperature; the number is checked first, as UsdLux crashes on NaN."""
    kelvin = light.number("inputs:colorTemperature", above=0.0, default=MIN_KELVIN)
    clamped = min(max(kelvin, MIN_KELVIN), MAX_KELVIN)
    if clamped != kelvin:
        light.note("inputs:colorTemperature", f"is {kelvin:g}, taken as {clamped:g}, the nearest that UsdLux defines")
    return black_body(clamped)


def black_body(kelvin: float) -> tuple[float, ...]:
    """Return the colour of a black body, linear Rec.709 of luminance 1, from `MIN_KELVIN` to `MAX_KELVIN`."""
    return tuple(UsdLux.BlackbodyTemperatureAsRgb(kelvin))


def _is_shaped(light: LightPrim) -> bool:
    """Return whether a light has a beam by the ShapingAPI; a dome has none, so each shaping value set on it is a fault.

    Programs apply the schema to domes, too, although a dome has no beam.
    """
    if not light.prim.HasAPI(UsdLux.ShapingAPI):
        return False
    for name in schema_names(SHAPING) if light.is_dome else ():
        if light.prim.GetAttribute(name).HasAuthoredValue():
            light.fault(name, "has no effect: a dome light has no beam", "remove it")
    return not light.is_dome


def _shaping(light: LightPrim, report: RigReport) -> Shaping:
    space, profile = "inputs:shaping:", None
    name, scale = f"{space}ies:file", light.number(f"{space}ies:angleScale")
    normalize = light.flag(f"{space}ies:normalize")
    if (file := light.file(name)) is not None:
        with report.collect(light.path.AppendProperty(name)):
            profile = load_profile(file, angle_scale=scale, normalize=normalize)
    return Shaping(
        cone_angle=light.number(f"{space}cone:angle", least=0.0),
        cone_softness=light.number(f"{space}cone:softness"),
        focus=light.number(f"{space}focus"),
        focus_tint=light.color(f"{space}focusTint"),
        profile=profile,
    )


def _shadow(light: LightPrim, unit: float) -> Shadow:
    space = "inputs:shadow:"
    return Shadow(
        enable=light.flag(f"{space}enable"),
        color=light.color(f"{space}color"),
        distance=unit * light.number(f"{space}distance"),
        falloff=unit * light.number(f"{space}falloff"),
        falloff_gamma=light.number(f"{space}falloffGamma", least=0.0),
    )


def _falloff(light: LightPrim, unit: float) -> Falloff:
    space, plain = "lookdev:falloff:", Falloff()
    return Falloff(
        virtual_distance=unit * light.number(f"{space}virtualDistance", least=0.0),
        exponent=light.number(f"{space}exponent", least=0.0, default=plain.exponent),
        start=unit * light.number(f"{space}start", least=0.0),
        end=unit * light.number(f"{space}end", above=0.0) if light.has(f"{space}end") else None,
    )


def _link(light: LightPrim, name: str) -> LightLink | None:
    """Return the rules of the collection `name` of a light, from USD's own query; None if it includes everything."""
    collection_name, collection = f"collection:{name}", Usd.CollectionAPI(light.prim, name)
    expression = light.prim.GetAttribute(f"{collection_name}:membershipExpression")
    if expression and expression.HasAuthoredValue():
        light.fault(expression.GetName(), "is not supported", f"'{collection_name}:includes' would be right")
        return None
    valid, reason = collection.Validate()
    if not valid:
        light.fault(collection_name, f"is not a valid collection: {clean_usd_message(reason)}")
        return None
    rule_map = collection.ComputeMembershipQuery().GetAsPathExpansionRuleMap()
    # The parts of an asset are prims, so that the rule for prims and properties includes the same parts as expandPrims.
    rules = {
        str(path): "expandPrims" if rule == Usd.Tokens.expandPrimsAndProperties else str(rule)
        for path, rule in rule_map.items()
        if path.IsAbsoluteRootOrPrimPath()
    }
    if rules == {"/": "expandPrims"}:
        return None
    if "expandPrims" not in rules.values() and "explicitOnly" not in rules.values():
        light.note(collection_name, "includes nothing")
    return LightLink(tuple(sorted(rules.items())))
