"""Which prims of a stage are the lights of a rig."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Usd, UsdGeom, UsdLux

from lookdev.errors import close_hint
from lookdev.light.kinds import LIGHT_KINDS
from lookdev.light.rig.attributes import OURS, LightPrim
from lookdev.light.rig.report import Report
from lookdev.stage import relationship_targets

USD_LIGHTS = {name: reader for kind in LIGHT_KINDS.values() for name, reader in kind.usd.items()}
"""The types of prims that are lights here, by their names in UsdLux."""

UNSUPPORTED = {
    "PortalLight": "a portal guides the sampling of other renderers, and is not needed here: deactivate it",
    "GeometryLight": "lights of a shape: a RectLight, DiskLight, SphereLight or CylinderLight would be right",
    "PluginLight": "a light of UsdLux would be right",
}
"""The types that are not, and what would be right."""

ALL_PRIMS = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
_SHOWN = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
_CONSULTED = ("consumeAndHalt", "consumeAndContinue")


def is_light(prim: Usd.Prim) -> bool:
    """Return whether a prim is a light, or seems to be one of a type that is not known."""
    return prim.HasAPI(UsdLux.LightAPI) or _is_foreign(prim)


def check_places(root: Usd.Prim, report: Report) -> None:
    """Add a fault for each attribute of lights, or of a root, that another prim carries: it has no effect there."""
    for prim in Usd.PrimRange(root, ALL_PRIMS):
        for attribute in () if is_light(prim) else prim.GetAuthoredPropertiesInNamespace("lookdev"):
            name = attribute.GetName().removeprefix("lookdev:")
            hint = "it is for lights" if name in OURS else close_hint(name, ("fit", *OURS), 0.6)
            if name == "fit":
                hint = "" if prim == root else "it is for the root of a rig, its default prim"
            if hint:
                report.fault(attribute.GetPath(), "has no effect here", hint)


def find_lights(root: Usd.Prim, time: Usd.TimeCode, report: Report) -> list[Usd.Prim]:
    """Return the lights at and below a prim that shine, in the order of the stage.

    Those that are hidden, or of a purpose that is not rendered, are noted. A light of no type in
    `USD_LIGHTS` is a fault. Hidden ancestors of the root hide nothing.
    """
    stage = root.GetStage()
    lights: list[Usd.Prim] = []
    foreign = [prim for prim in Usd.PrimRange(root, ALL_PRIMS) if _is_foreign(prim)]
    for path in sorted({*_listed(root, report), *(prim.GetPath() for prim in foreign)}):
        prim = stage.GetPrimAtPath(path)
        if not prim:
            report.fault(path, "a light list names it, but there is no such prim")
        elif prim.IsA(UsdLux.LightFilter):
            continue  # it has an effect through a light that names it
        elif left_out := _left_out(prim, root, time, report):
            report.note(path, f"{left_out}, left out")
        elif fault := _refused(prim):
            report.fault(path, *fault)
        else:
            lights.append(prim)
    return lights


def _listed(root: Usd.Prim, report: Report) -> list[Sdf.Path]:
    """Return the paths of lights and filters by `UsdLuxLightListAPI`.

    "In this mode, ComputeLightList() will traverse the model hierarchy, accumulating cached light lists": with the
    caches it finds no light outside of models, so it is asked for them only where there is a cache to consult.
    """
    api = UsdLux.LightListAPI(root)
    every = list(api.ComputeLightList(UsdLux.LightListAPI.ComputeModeIgnoreCache))
    if not any(_is_cache(prim) for prim in Usd.PrimRange(root, ALL_PRIMS)):
        return every
    listed = list(api.ComputeLightList(UsdLux.LightListAPI.ComputeModeConsultModelHierarchyCache))
    for path in sorted(set(every) - set(listed)):
        report.note(path, "is in no light list of its models, left out")
    return listed


def _is_cache(prim: Usd.Prim) -> bool:
    attribute = prim.GetAttribute("lightList:cacheBehavior")
    return bool(attribute) and attribute.Get() in _CONSULTED


def _is_foreign(prim: Usd.Prim) -> bool:
    """Return whether a prim seems to be a light of a type that USD does not know."""
    name = str(prim.GetTypeName())
    unknown = bool(name) and not prim.IsA(Usd.Typed)
    return unknown and ("light" in name.lower() or bool(close_hint(name, list(USD_LIGHTS))))


def _left_out(prim: Usd.Prim, root: Usd.Prim, time: Usd.TimeCode, report: Report) -> str:
    """Return why a light does not shine; "" where it does."""
    each = prim
    while each and each != root.GetParent() and not each.IsPseudoRoot():
        if each.IsA(UsdGeom.Imageable) and _is_hidden(LightPrim(each, time, report)):
            return "is hidden" if each == prim else f"is hidden by {each.GetPath()}"
        each = each.GetParent()
    purpose = UsdGeom.Imageable(prim).ComputePurpose() if prim.IsA(UsdGeom.Imageable) else _SHOWN[0]
    return "" if purpose in _SHOWN else f"is of purpose {purpose}"


def _is_hidden(prim: LightPrim) -> bool:
    inherited, invisible = UsdGeom.Tokens.inherited, UsdGeom.Tokens.invisible
    return bool(prim.text("visibility", inherited, (inherited, invisible)) == invisible)


def _refused(prim: Usd.Prim) -> tuple[str, str] | None:
    """Return what is wrong with a light before it is read, and what would be right."""
    kind = str(prim.GetTypeName())
    if _is_foreign(prim):
        known = close_hint(kind, [*USD_LIGHTS, *UNSUPPORTED], 0.6)
        return f"{kind} is no type of USD's lights", known or f"known: {', '.join(USD_LIGHTS)}"
    if kind not in USD_LIGHTS:
        right = UNSUPPORTED.get(kind, UNSUPPORTED["GeometryLight"])
        what = f"a light of type {kind}" if kind in UNSUPPORTED else f"a {kind or 'prim'} that is a light by LightAPI"
        return f"{what} is not supported", right
    if filters := relationship_targets(prim.GetRelationship("light:filters")):
        return f"light filters are not supported: it has {', '.join(map(str, filters))}", "remove 'light:filters'"
    for above in _above(prim):
        if above.IsA(UsdGeom.PointInstancer):
            return f"is in the PointInstancer {above.GetPath()}", "lights of point instances are not supported"
    return None


def _above(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    while prim := prim.GetParent():
        yield prim
