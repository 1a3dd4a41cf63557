"""Other values of the lights of a rig: what a wedge varies."""

from __future__ import annotations

from collections.abc import Mapping

from pxr import Gf, Sdf, Tf, Usd

from lookdev.errors import Fault, RigError, nearest_hint
from lookdev.light.rig.find import ALL_PRIMS, is_light
from lookdev.stage import Composed

Value = float | tuple[float, float, float] | str


def change_values(composed: Composed, values: Mapping[str, Value]) -> None:
    """Set values of lights on a stage, in its session: ``"Key.intensity"``, ``"/Rig/Key.shaping:cone:angle"``.

    A light is named by its path, or by its prim's name where that is one light's alone. Raises RigError where there is
    no such light or input, or the value is not of its type.
    """
    stage = composed.stage
    lights = [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), ALL_PRIMS) if is_light(prim)]
    faults = []
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for parameter, value in values.items():
            name, _, key = parameter.rpartition(".")
            found = [prim for prim in lights if name in (prim.GetName(), str(prim.GetPath()))]
            what, hint = "", ""
            if not found:
                known = [*(prim.GetName() for prim in lights), *(str(prim.GetPath()) for prim in lights)]
                what, hint = f"has no light '{name}'", nearest_hint(name, known)
            elif len(found) > 1:
                paths = " or ".join(str(prim.GetPath()) for prim in found)
                what, hint = f"several lights are called '{name}'", f"write {paths}"
            else:
                what, hint = _set(found[0], key, value)
            if what:
                faults.append(Fault(str(composed.composition.file), f"light:{parameter}", what, hint))
    if faults:
        raise RigError(faults)


def _set(light: Usd.Prim, key: str, value: Value) -> tuple[str, str]:
    """Set a value; return what is wrong, and what would be right."""
    keys = [each.GetName() for each in light.GetAttributes() if each.GetName().startswith(("inputs:", "lookdev:"))]
    attribute = light.GetAttribute(key if key in keys else f"inputs:{key}")
    if not attribute:
        known = [each.removeprefix("inputs:") for each in keys]
        return f"{light.GetPath()} has no input '{key}'", nearest_hint(key, known)
    kind = attribute.GetTypeName()
    if kind == Sdf.ValueTypeNames.Bool and isinstance(value, float | int) and value in (0, 1):
        given: object = bool(value)
    elif isinstance(value, tuple):
        given = Gf.Vec3f(*value)
    else:
        given = value
    try:
        if attribute.Set(given):
            return "", ""
    except (Tf.ErrorException, TypeError):
        pass
    return f"{attribute.GetPath()} cannot be {value!r}", f"it is a {kind}"
