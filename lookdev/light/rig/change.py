"""Changes of the values of a rig's lights. Wedges of a job, which render a series of values, use them."""

from __future__ import annotations

from collections.abc import Mapping

from pxr import Gf, Sdf, Tf, Usd

from lookdev.errors import Fault, RigError, nearest_hint
from lookdev.light.rig.find import ALL_PRIMS, is_light
from lookdev.stage import Composed

LightValue = float | tuple[float, float, float] | str


def change_values(composed: Composed, values: Mapping[str, LightValue]) -> None:
    """Set attributes of lights in the session layer of a stage.

    A key of `values` is the light, a dot and the name of an input: ``"Key.intensity"``,
    ``"/Rig/Key.shaping:cone:angle"``. The light is named by its path, or by its prim's name if no other light has that
    name. Raises RigError if there is no such light or input, or a value is not of the input's type.
    """
    stage = composed.stage
    lights = [prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), ALL_PRIMS) if is_light(prim)]
    faults = []
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for parameter, value in values.items():
            name, _, key = parameter.rpartition(".")
            matches = [prim for prim in lights if name in (prim.GetName(), str(prim.GetPath()))]
            problem, hint = "", ""
            if not matches:
                names = [*(prim.GetName() for prim in lights), *(str(prim.GetPath()) for prim in lights)]
                problem, hint = f"has no light '{name}'", nearest_hint(name, names)
            elif len(matches) > 1:
                paths = " or ".join(str(prim.GetPath()) for prim in matches)
                problem, hint = f"several lights are called '{name}'", f"write {paths}"
            else:
                problem, hint = _set(matches[0], key, value)
            if problem:
                faults.append(Fault(str(composed.composition.file), f"light:{parameter}", problem, hint))
    if faults:
        raise RigError(faults)


def _set(light: Usd.Prim, key: str, value: LightValue) -> tuple[str, str]:
    """Set the value of a light's attribute; return the problem and a hint, both "" on success."""
    names = map(Usd.Attribute.GetName, light.GetAttributes())
    keys = [name for name in names if name.startswith(("inputs:", "lookdev:"))]
    attribute = light.GetAttribute(key if key in keys else f"inputs:{key}")
    if not attribute:
        return f"{light.GetPath()} has no input '{key}'", nearest_hint(key, [k.removeprefix("inputs:") for k in keys])
    type_name = attribute.GetTypeName()
    if type_name == Sdf.ValueTypeNames.Bool and isinstance(value, float | int) and value in (0, 1):
        usd_value: object = bool(value)
    elif isinstance(value, tuple):
        usd_value = Gf.Vec3f(*value)
    else:
        usd_value = value
    try:
        if attribute.Set(usd_value):
            return "", ""
    except (Tf.ErrorException, TypeError):
        pass
    return f"{attribute.GetPath()} cannot be {value!r}", f"it is a {type_name}"
