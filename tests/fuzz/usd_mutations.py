"""What can be wrong with a property of a USD file, by the role of the property, and what must become of it."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cases import ANY, NAMED, NOTED, REFUSED, SOUND
from pxr import Gf, Sdf, Vt

Change = Callable[[Any, random.Random], object]
"""Changes the spec of a property in place."""


@dataclass(frozen=True)
class Mutation:
    """A change, and the outcomes that are right. Where `own`, a message names the attribute too, not only the prim."""

    name: str
    change: Change
    expected: frozenset[str]
    own: bool = True


def _put(attribute: Any, values: list[Any]) -> None:
    attribute.default = type(attribute.default)(values)


def _one(change: Callable[[Any, random.Random], Any]) -> Change:
    """Return a change of a value, or of one value of an array."""

    def changed(attribute: Any, rng: random.Random) -> None:
        if attribute.typeName.isArray:
            values = list(attribute.default)
            i = rng.randrange(len(values))
            values[i] = change(values[i], rng)
            _put(attribute, values)
        else:
            attribute.default = change(attribute.default, rng)

    return changed


def _number(number: float) -> Change:
    """Return a change of one number of a value, or of one value of an array."""

    def replace(value: Any, rng: random.Random) -> Any:
        if isinstance(value, (float, int)):
            return type(value)(number)
        if isinstance(value, (Gf.Quatf, Gf.Quath, Gf.Quatd)):
            return type(value)(number, value.GetImaginary())
        copy = type(value)(value)
        if isinstance(value, Gf.Matrix4d):
            copy[rng.randrange(4), rng.randrange(3)] = number
        else:
            copy[rng.randrange(len(value))] = number
        return copy

    return _one(replace)


def _zero(value: Any) -> Any:
    if isinstance(value, (float, int)):
        return type(value)(0)
    return type(value)(*[0.0] * (4 if isinstance(value, (Gf.Quatf, Gf.Quath)) else len(value)))


def _zeros(attribute: Any, rng: random.Random) -> None:
    """Make all numbers 0."""
    if attribute.typeName.isArray:
        _put(attribute, [_zero(value) for value in attribute.default])
    else:
        attribute.default = _zero(attribute.default)


def _values(change: Callable[[list[Any]], list[Any]]) -> Change:
    """Return a change of the values of an array."""
    return lambda attribute, rng: _put(attribute, change(list(attribute.default)))


def _sampled(name: str) -> Change:
    """Return a change of the only time sample."""

    def sampled(attribute: Any, rng: random.Random) -> None:
        before = attribute.default
        CHANGES[name](attribute, rng)
        after = attribute.default
        attribute.default = before
        attribute.layer.SetTimeSample(attribute.path, 0.0, after)

    return sampled


def _sampled_at(time: float, name: str) -> Change:
    """Return a change of what an attribute's first time sample has, as a sample at a time."""

    def sampled(attribute: Any, rng: random.Random) -> None:
        layer, path = attribute.layer, attribute.path
        attribute.default = layer.QueryTimeSample(path, layer.ListTimeSamplesForPath(path)[0])
        CHANGES[name](attribute, rng)
        value = attribute.default
        attribute.ClearDefaultValue()
        layer.SetTimeSample(path, time, value)

    return sampled


_TYPES: dict[str, Any] = {
    "int[]": Vt.IntArray([1, 0]),
    "float[]": Vt.FloatArray([0.5, 1.0]),
    "float2[]": Vt.Vec2fArray([Gf.Vec2f(0.5, 1.0)] * 2),
    "float4[]": Vt.Vec4fArray([Gf.Vec4f(0.5, 1.0, 2.0, 1.0)] * 2),
    "string[]": Vt.StringArray(["a", "b"]),
    "token[]": Vt.TokenArray(["a", "b"]),
    "matrix4d[]": Vt.Matrix4dArray([Gf.Matrix4d(1.0)] * 2),
    "quatf[]": Vt.QuatfArray([Gf.Quatf(1.0)] * 2),
    "asset[]": Sdf.AssetPathArray([Sdf.AssetPath("a.png")] * 2),
    "int": 1,
    "bool": True,
    "float": 0.5,
    "float3": Gf.Vec3f(0.5, 1.0, 2.0),
    "string": "word",
    "token": "word",
    "matrix4d": Gf.Matrix4d(1.0),
    "asset": Sdf.AssetPath("a.png"),
}
"""A value of each type that an attribute may be changed to."""


def _retype(attribute: Any, kind: str, value: Any) -> None:
    """Replace an attribute by one of another type; its interpolation and the like stay."""
    prim, name = attribute.owner, attribute.name
    infos = {
        key: attribute.GetInfo(key) for key in ("interpolation", "elementSize", "weight") if attribute.HasInfo(key)
    }
    prim.RemoveProperty(attribute)
    other = Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Find(kind))
    for key, info in infos.items():
        other.SetInfo(key, info)
    other.default = value


def _retyped(kind: str, value: Any) -> Change:
    return lambda attribute, rng: _retype(attribute, kind, value)


def _mistype(attribute: Any, rng: random.Random) -> None:
    """Give the attribute a value that is not of its type: a stronger layer declares the type, as `declared` has it."""
    kind = attribute.typeName
    attribute.layer.customLayerData = {"path": str(attribute.path), "type": str(kind)}
    texts = kind.type.typeName in ("string", "token", "VtArray<string>", "VtArray<TfToken>")
    wrong = rng.choice(("matrix4d[]", "matrix4d") if texts else ("string[]", "matrix4d[]", "string"))
    _retype(attribute, wrong, _TYPES[wrong])


def declared(layer: Sdf.Layer) -> tuple[str, str] | None:
    """Return the path and type of the attribute to which `mistyped` gives a value of another type."""
    data = layer.customLayerData
    return (data["path"], data["type"]) if data else None


def _sample_default(attribute: Any, rng: random.Random) -> None:
    attribute.layer.SetTimeSample(attribute.path, rng.choice((-3.0, 0.0, 7.0)), attribute.default)


def _target(path: str) -> Change:
    """Return a change of a relationship's first target, or of an attribute's connection; '' removes all."""

    def change(spec: Any, rng: random.Random) -> None:
        edits = spec.targetPathList if isinstance(spec, Sdf.RelationshipSpec) else spec.connectionPathList
        first = str(spec.path) if path == "itself" else path
        edits.explicitItems = [Sdf.Path(first), *list(edits.explicitItems)[1:]] if path else []

    return change


CHANGES: dict[str, Change] = {
    **{name: _number(float(name)) for name in ("nan", "inf", "-inf", "1e30", "0", "-1", "2", "64")},
    "2^31-1": _number(2**31 - 1),
    "-2^31": _number(-(2**31)),
    "all 0": _zeros,
    "shorter": _values(lambda values: values[:-1]),
    "longer": _values(lambda values: [*values, values[-1]]),
    "empty": _values(lambda values: []),
    "doubled": _values(lambda values: values[:1] * len(values)),
    "reversed": _values(lambda values: values[::-1]),
    "shorter sample": _sampled("shorter"),
    "empty sample": _sampled("empty"),
    "sample at the time shorter": _sampled_at(3.0, "shorter"),
    "sample at the time empty": _sampled_at(3.0, "empty"),
    "same sample": _sample_default,
    "blocked": lambda attribute, rng: setattr(attribute, "default", Sdf.ValueBlock()),
    "mistyped": _mistype,
    **{kind: _retyped(kind, value) for kind, value in _TYPES.items()},
    "hole -1": _retyped("int[]", Vt.IntArray([-1])),
    "hole 6": _retyped("int[]", Vt.IntArray([6])),
    **{f"file '{name}'": _retyped("asset", Sdf.AssetPath(name)) for name in ("nowhere.png", "./", "asset.usda", "")},
    **{
        f"interpolation {name}": lambda attribute, rng, name=name: attribute.SetInfo("interpolation", name.strip("'"))
        for name in ("foo", "constant", "uniform", "''")
    },
    # How many elements make one value.
    "elementSize": lambda attribute, rng: attribute.SetInfo("elementSize", rng.choice((2, 3))),
    "elementSize of none": lambda attribute, rng: attribute.SetInfo("elementSize", rng.choice((-1, 0, 3, 1000))),
    "control": _one(lambda value, rng: "Ünknown\x1b[31m"),
    "500 letters": _one(lambda value, rng: "x" * 500),
}
"""Changes by name; further ones are "'a word'", and "-> /a/target" of a relationship or a connection."""


def _change_named(name: str) -> Change:
    if name.startswith("'"):
        return _one(lambda value, rng: name.strip("'"))
    if name.startswith("->"):
        return _target(name.removeprefix("->").strip())
    return CHANGES[name]


_OUTCOMES = {
    "refused": REFUSED,
    "noted": NOTED,
    "sound": SOUND,
    "named": NAMED,
    "harmless": REFUSED | SOUND,
    "unread": NOTED | SOUND,
    "any": ANY,
}


def _role(**changes: str) -> tuple[Mutation, ...]:
    """Return the mutations of a role, from their names by outcome; "~" before a name: not `own`."""
    return tuple(
        Mutation(name.removeprefix("~"), _change_named(name.removeprefix("~")), _OUTCOMES[outcome], name[0] != "~")
        for outcome, names in changes.items()
        for name in names.split(", ")
    )


_NUMBERS = "nan, inf, -inf, 1e30"
_NO_ARRAY = "float, string, matrix4d, bool"
_TEXTS = "string[], token[], asset[], quatf[], matrix4d[]"
_OTHERS = f"{_TEXTS}, {_NO_ARRAY}, mistyped"
_COUNT = "~shorter, ~longer, ~empty, ~blocked, ~shorter sample, ~empty sample"
_VECTORS = f"int[], float[], float2[], float4[], {_OTHERS}"
_FLOATS = f"{_NUMBERS}, float2[], float4[], {_OTHERS}"
_INTS = f"-1, 2^31-1, -2^31, float[], float2[], {_OTHERS}"
_SCALAR = "string, float3, token, float[], asset, bool"
_PRIMVAR = "nan, inf, -inf, interpolation foo, interpolation constant, shorter"
_WORDS, _NO_WORD = "'foo', '', control, 500 letters", "int, float3, token[], asset"
_WORD = _role(refused=f"{_WORDS}, {_NO_WORD}", harmless="mistyped")
_FREE_WORD = _role(noted=_WORDS, refused=_NO_WORD, harmless="mistyped")  # shown or hidden by the rules of Hydra

ROLES: dict[str, tuple[Mutation, ...]] = {
    # Points of a mesh or curves that other attributes follow, and of a mesh that has none.
    "points": _role(refused=f"{_NUMBERS}, {_VECTORS}, {_COUNT}", sound="same sample"),
    "bare": _role(refused=f"{_NUMBERS}, {_VECTORS}, ~shorter, ~empty", sound="same sample, longer"),
    "counts": _role(refused=f"{_INTS}, {_COUNT}", sound="same sample"),
    "indices": _role(refused=f"{_INTS}, 64, {_COUNT}", sound="same sample"),
    "fixed_indices": _role(refused=f"{_INTS}, 64, ~shorter, ~longer", sound="same sample"),
    "subset": _role(refused=f"{_INTS}, 2", sound="same sample, longer"),
    "holes": _role(refused=f"hole -1, hole 6, float[], float2[], {_OTHERS}", sound="same sample"),
    "sharpness": _role(refused=f"nan, float2[], {_OTHERS}, {_COUNT}", sound="same sample"),
    "normals": _role(refused=f"nan, inf, -inf, {_VECTORS}, interpolation foo, longer", sound="same sample"),
    "uv": _role(
        refused="nan, inf, -inf, mistyped, interpolation foo, interpolation uniform",
        named=f"float[], float4[], {_TEXTS}, {_NO_ARRAY}, empty, elementSize",
        sound="same sample",
    ),
    "primvar": _role(
        refused=f"{_PRIMVAR}, longer", named="interpolation '', elementSize, empty, mistyped", sound="same sample"
    ),
    "color": _role(
        refused=_PRIMVAR,
        named=f"interpolation '', elementSize, int[], float[], float2[], float4[], {_TEXTS}, string, float",
    ),
    "constant": _role(refused="nan, inf, -inf", named="mistyped"),
    "unread": _role(sound=f"{_NUMBERS}, {_OTHERS}, blocked"),
    "velocities": _role(refused=f"{_NUMBERS}, {_VECTORS}", sound="same sample, shorter, blocked"),
    "ignored": _role(sound=f"{_TEXTS}, {_NO_ARRAY}, shorter, blocked"),
    "token": _WORD,
    "visibility": _FREE_WORD,
    "purpose": _FREE_WORD,
    "size": _role(refused=f"-1, {_NUMBERS}, {_SCALAR}, mistyped", named="~0", sound="same sample"),
    "part": _role(refused=f"-1, {_NUMBERS}, {_SCALAR}"),
    "widths": _role(refused=f"{_FLOATS}, ~shorter, ~longer, -1", sound="same sample"),
    "width": _role(refused=f"{_FLOATS}, -1", named="~0", sound="same sample"),
    "knots": _role(refused=f"{_FLOATS}, {_COUNT}, ~reversed, doubled", sound="same sample"),
    "ranges": _role(refused=f"float[], {_TEXTS}, {_NO_ARRAY}, ~all 0", harmless=_NUMBERS),
    "weights": _role(refused=f"{_FLOATS}, 0, -1, shorter, longer", sound="same sample"),
    "quaternions": _role(
        refused="float[], string[], matrix4d[], string, shorter, mistyped", named=_NUMBERS, any="~all 0"
    ),
    "scales": _role(
        refused="float[], float4[], string[], matrix4d[], string, shorter, mistyped", named=f"{_NUMBERS}, ~all 0"
    ),
    "turn": _role(refused="nan, inf, -inf", named="string, float[], token, bool, asset"),
    "uv_indices": _role(refused=f"{_INTS}, 64, ~shorter, ~longer", named="~empty, ~empty sample", sound="same sample"),
    "ids": _role(refused="float[], string[], string, shorter, mistyped"),
    "invisible": _role(refused="float[], string[], string, mistyped", sound="longer"),
    "targets": _role(refused="-> /Root/Nowhere, ~->, -> itself, ~-> /Root, -> /Root.points"),
    "target": _role(refused="-> /Root/Nowhere, -> /Root", named="~-> itself, ~->"),
    "lenient": _role(noted="-> /Root/Nowhere, -> /Root", named="~-> itself"),
    "placement": _role(named=f"{_NUMBERS}, string, float[], token, bool, asset, mistyped", sound="same sample"),
    "scale": _role(named=f"{_NUMBERS}, ~0, string, float[], matrix4d"),
    "order": _role(named="'foo', 'xformOp:translate:pivot', '', 'xformOp:frobnicate', int[], string[], float, token"),
    "matrix": _role(refused="nan, inf, float[], string, float3, mistyped"),
    "matrices": _role(refused="nan, inf, shorter, longer, float[], float4[], string[], string"),
    "joint_indices": _role(
        refused=f"{_INTS}, 2, shorter, longer, elementSize of none, interpolation foo", sound="same sample"
    ),
    "joint_weights": _role(
        refused=f"{_FLOATS}, shorter, longer, elementSize of none, interpolation foo", sound="same sample"
    ),
    "names": _role(refused="int[], float, matrix4d[], mistyped", named="~shorter, ~longer"),
    "own_joints": _role(refused="int[], float, matrix4d[], mistyped, 'foo'"),
    "joints": _role(refused="doubled, reversed, 'a b/c//', '', empty, ~shorter, int[], float, matrix4d[]"),
    "animated": _role(refused="shorter, longer, int[], float, matrix4d[]"),
    "components": _role(refused="nan, inf, shorter, longer, int[], float[], string[], string, mistyped", noted="empty"),
    "morphs": _role(refused=f"{_FLOATS}, shorter, longer", sound="same sample"),
    "offsets": _role(refused=f"{_NUMBERS}, int[], float[], float4[], string[], string, ~shorter, ~longer"),
    "binding": _role(noted="-> /Root/Nowhere, -> /Root, -> /Root/Looks/Preview.outputs:surface", named="~-> itself"),
    "members": _role(refused="~-> /Root/Body.collection:paint", named="~-> /Root/Body.collection:other"),
    "expansion": _role(named="~'foo'", any="int, token[]"),
    "terminal": _role(noted="~-> /Root/Nowhere.outputs:surface, ~-> itself, ~-> /Root/Body.outputs:surface"),
    "shader": _role(noted="~'foo', ~'', ~blocked", unread="int, float, token[]"),
    "connection": _role(
        noted="-> /Root/Nowhere.outputs:rgb, -> itself, -> /Root/Looks.outputs:rgb, "
        "~-> /Root/Looks/Preview/Surface.inputs:roughness"
    ),
    "input": _role(noted="mistyped, int[], float[], matrix4d"),
    "varname": _role(noted="''", named="int, float[]"),
    "image": _role(refused="file 'nowhere.png'", named="file './', file 'asset.usda', int, float[]", any="file ''"),
    "lens": _role(refused=f"{_NUMBERS}, 0, -1, {_SCALAR}, mistyped"),
    "clipping": _role(refused=f"nan, -inf, all 0, {_SCALAR}, mistyped"),
    "number": _role(refused=f"{_NUMBERS}, {_SCALAR}, mistyped"),
    # USD holds a value whose neighbour has another length.
    "sampled": _role(named="~sample at the time shorter, ~sample at the time empty"),
}
ROLES["inherited"] = ROLES["constant"]
