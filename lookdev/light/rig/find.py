"""Search for the light prims of a rig on its stage, and faults of prims that look like lights but have no effect."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom, UsdLux

from lookdev.errors import close_hint
from lookdev.light.kinds import LIGHT_KINDS
from lookdev.light.rig.attributes import LOOKDEV_ATTRIBUTES, LightPrim, RigReport
from lookdev.stage import prim_and_ancestors, relationship_targets

USD_LIGHTS = {name: reader for kind in LIGHT_KINDS.values() for name, reader in kind.usd.items()}
"""The readers of the supported types of light prims, by the names of the types in UsdLux."""

UNSUPPORTED = {
    "PortalLight": "a portal guides the sampling of other renderers, and is not needed here: deactivate it",
    "GeometryLight": "lights of a shape: a RectLight, DiskLight, SphereLight or CylinderLight would be right",
    "PluginLight": "a light of UsdLux would be right",
}
"""The types of UsdLux that are not supported, and a hint for each."""

ALL_PRIMS = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
"""The predicate of prims to traverse: all that USD traverses by default, and those inside of instances."""

_RENDERED_PURPOSES = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
# The values of ``lightList:cacheBehavior`` with which USD uses the light list that is cached on a prim.
_CONSULTING = ("consumeAndHalt", "consumeAndContinue")


def is_light(prim: Usd.Prim) -> bool:
    """Return whether a prim is a light, or seems to be a light of an unknown type."""
    return prim.HasAPI(UsdLux.LightAPI) or _is_unknown_light(prim)


def check_attribute_owners(root: Usd.Prim, report: RigReport) -> None:
    """Add a fault for each ``lookdev:`` attribute on a prim where it has no effect.

    Such a prim is neither a light nor, for ``lookdev:fit``, the root of the rig. Unknown names are faults only if they
    resemble an attribute of lights.
    """
    for prim in Usd.PrimRange(root, ALL_PRIMS):
        for attribute in () if is_light(prim) else prim.GetAuthoredPropertiesInNamespace("lookdev"):
            name = attribute.GetName().removeprefix("lookdev:")
            known_names = ("fit", *LOOKDEV_ATTRIBUTES)
            hint = "it is for lights" if name in LOOKDEV_ATTRIBUTES else close_hint(name, known_names, 0.6)
            if name == "fit":
                hint = "" if prim == root else "it is for the root of a rig, its default prim"
            if hint:
                report.fault(attribute.GetPath(), "has no effect here", hint)


def find_lights(root: Usd.Prim, time: Usd.TimeCode, report: RigReport) -> list[Usd.Prim]:
    """Return the visible lights at and below `root`, sorted by path.

    A light that is hidden, or whose purpose is not rendered, is left out with a note. A light whose type is not in
    `USD_LIGHTS` is a fault. Hidden ancestors of the root have no effect.
    """
    stage = root.GetStage()
    lights: list[Usd.Prim] = []
    unknown = [prim for prim in Usd.PrimRange(root, ALL_PRIMS) if _is_unknown_light(prim)]
    for path in sorted({*_light_list_paths(root, report), *(prim.GetPath() for prim in unknown)}):
        prim = stage.GetPrimAtPath(path)
        if not prim:
            report.fault(path, "a light list names it, but there is no such prim")
        elif prim.IsA(UsdLux.LightFilter):
            continue  # `_type_fault` reports the light that uses this filter
        elif reason := _reason_left_out(prim, root, time, report):
            report.note(path, f"{reason}, left out")
        elif fault := _type_fault(prim):
            report.fault(path, *fault)
        else:
            lights.append(prim)
    return lights


def _light_list_paths(root: Usd.Prim, report: RigReport) -> list[Sdf.Path]:
    """Return the paths of lights and filters at and below `root`, from `UsdLuxLightListAPI`.

    The mode with caches is used only if a prim has a cached light list. "In this mode, ComputeLightList() will traverse
    the model hierarchy, accumulating cached light lists"; it therefore misses lights outside of models.
    """
    api = UsdLux.LightListAPI(root)
    all_paths = list(api.ComputeLightList(UsdLux.LightListAPI.ComputeModeIgnoreCache))
    if not any(_is_cache(prim) for prim in Usd.PrimRange(root, ALL_PRIMS)):
        return all_paths
    listed = list(api.ComputeLightList(UsdLux.LightListAPI.ComputeModeConsultModelHierarchyCache))
    for path in sorted(set(all_paths) - set(listed)):
        report.note(path, "is in no light list of its models, left out")
    return listed


def _is_cache(prim: Usd.Prim) -> bool:
    """Return whether a prim has a cached light list that USD uses."""
    attribute = prim.GetAttribute("lightList:cacheBehavior")
    return bool(attribute) and attribute.Get() in _CONSULTING


def _is_unknown_light(prim: Usd.Prim) -> bool:
    """Return whether a prim seems to be a light of a type that USD lacks."""
    name = str(prim.GetTypeName())
    unknown = bool(name) and not prim.IsA(Usd.Typed)
    return unknown and ("light" in name.lower() or bool(close_hint(name, list(USD_LIGHTS))))


def _reason_left_out(prim: Usd.Prim, root: Usd.Prim, time: Usd.TimeCode, report: RigReport) -> str:
    """Return the reason why a light is left out; "" if it is rendered."""
    for ancestor in prim_and_ancestors(prim):
        if ancestor.IsA(UsdGeom.Imageable) and _is_hidden(LightPrim(ancestor, time, report)):
            return "is hidden" if ancestor == prim else f"is hidden by {ancestor.GetPath()}"
        if ancestor == root:
            break
    purpose = UsdGeom.Imageable(prim).ComputePurpose() if prim.IsA(UsdGeom.Imageable) else _RENDERED_PURPOSES[0]
    return "" if purpose in _RENDERED_PURPOSES else f"is of purpose {purpose}"


def _is_hidden(prim: LightPrim) -> bool:
    inherited, invisible = UsdGeom.Tokens.inherited, UsdGeom.Tokens.invisible
    return bool(prim.text("visibility", inherited, (inherited, invisible)) == invisible)


def _type_fault(prim: Usd.Prim) -> tuple[str, str] | None:
    """Return the problem of an unsupported light and a hint; None if it is supported."""
    kind = str(prim.GetTypeName())
    if _is_unknown_light(prim):
        hint = close_hint(kind, [*USD_LIGHTS, *UNSUPPORTED], 0.6)
        return f"{kind} is not a type of USD's lights", hint or f"known: {', '.join(USD_LIGHTS)}"
    if kind not in USD_LIGHTS:
        right = UNSUPPORTED.get(kind, UNSUPPORTED["GeometryLight"])
        problem = (
            f"a light of type {kind}" if kind in UNSUPPORTED else f"a {kind or 'prim'} that is a light by LightAPI"
        )
        return f"{problem} is not supported", right
    if filters := relationship_targets(prim.GetRelationship("light:filters")):
        return f"light filters are not supported: it has {', '.join(map(str, filters))}", "remove 'light:filters'"
    for ancestor in prim_and_ancestors(prim):
        if ancestor.IsA(UsdGeom.PointInstancer):
            return f"is in the PointInstancer {ancestor.GetPath()}", "lights of point instances are not supported"
    return None
