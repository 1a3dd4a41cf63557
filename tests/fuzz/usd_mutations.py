"""What can be wrong with a property of a USD file, by the role of the property, and what must become of it."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pxr import Gf, Sdf, Vt

Change = Callable[[Any, random.Random], None]
"""Changes the spec of a property in place."""

REFUSED, NOTED, SOUND = frozenset({"refused"}), frozenset({"noted"}), frozenset({"sound"})
NAMED = REFUSED | NOTED
HARMLESS = SOUND | REFUSED
ANY = SOUND | NAMED


@dataclass(frozen=True)
class Mutation:
    """A change, and the outcomes that are right. Where `own`, a message names the attribute too, not only the prim."""

    name: str
    change: Change
    expected: frozenset[str]
    own: bool = True


def _elements(attribute: Any) -> list[Any]:
    return list(attribute.default)


def _put(attribute: Any, values: list[Any]) -> None:
    attribute.default = type(attribute.default)(values)


def _with(value: Any, number: float, rng: random.Random) -> Any:
    """Return a value with one of its numbers replaced."""
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


def number(value: float) -> Change:
    """Return a change of one number of a value, or of one value of an array."""

    def change(attribute: Any, rng: random.Random) -> None:
        if attribute.typeName.isArray:
            values = _elements(attribute)
            i = rng.randrange(len(values))
            values[i] = _with(values[i], value, rng)
            _put(attribute, values)
        else:
            attribute.default = _with(attribute.default, value, rng)

    return change


def shorter(attribute: Any, rng: random.Random) -> None:
    """Leave out the last value."""
    _put(attribute, _elements(attribute)[:-1])


def longer(attribute: Any, rng: random.Random) -> None:
    """Repeat the last value."""
    values = _elements(attribute)
    _put(attribute, [*values, values[-1]])


def empty(attribute: Any, rng: random.Random) -> None:
    """Leave out all values."""
    _put(attribute, [])


def blocked(attribute: Any, rng: random.Random) -> None:
    """Block the value."""
    attribute.default = Sdf.ValueBlock()


def same(attribute: Any, rng: random.Random) -> None:
    """Author the values as a time sample."""
    attribute.layer.SetTimeSample(attribute.path, rng.choice((-3.0, 0.0, 7.0)), attribute.default)


def _sampled(change: Change) -> Change:
    """Return a change of the only time sample."""

    def sampled(attribute: Any, rng: random.Random) -> None:
        before = attribute.default
        change(attribute, rng)
        after = attribute.default
        attribute.default = before
        attribute.layer.SetTimeSample(attribute.path, 0.0, after)

    return sampled


_ARRAYS: dict[str, Any] = {
    "int[]": Vt.IntArray([1, 0]),
    "int64[]": Vt.Int64Array([1, 0]),
    "bool[]": Vt.BoolArray([True, False]),
    "float[]": Vt.FloatArray([0.5, 1.0]),
    "float2[]": Vt.Vec2fArray([Gf.Vec2f(0.5, 1.0)] * 2),
    "float3[]": Vt.Vec3fArray([Gf.Vec3f(0.5, 1.0, 2.0)] * 2),
    "float4[]": Vt.Vec4fArray([Gf.Vec4f(0.5, 1.0, 2.0, 1.0)] * 2),
    "string[]": Vt.StringArray(["a", "b"]),
    "token[]": Vt.TokenArray(["a", "b"]),
    "matrix4d[]": Vt.Matrix4dArray([Gf.Matrix4d(1.0)] * 2),
    "quatf[]": Vt.QuatfArray([Gf.Quatf(1.0)] * 2),
    "asset[]": Sdf.AssetPathArray([Sdf.AssetPath("a.png")] * 2),
}
_SCALARS: dict[str, Any] = {
    "int": 1,
    "bool": True,
    "float": 0.5,
    "float3": Gf.Vec3f(0.5, 1.0, 2.0),
    "string": "word",
    "token": "word",
    "matrix4d": Gf.Matrix4d(1.0),
    "asset": Sdf.AssetPath("a.png"),
}
_KINDS = {**_ARRAYS, **_SCALARS}


def _retyped(attribute: Any, kind: str, value: Any) -> None:
    """Replace an attribute by one of another type; its interpolation and the like stay."""
    prim, name = attribute.owner, attribute.name
    kept = {key: attribute.GetInfo(key) for key in ("interpolation", "elementSize", "weight") if attribute.HasInfo(key)}
    prim.RemoveProperty(attribute)
    made = Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Find(kind))
    for key, info in kept.items():
        made.SetInfo(key, info)
    made.default = value


def of_type(kind: str) -> Change:
    """Return a change to another type, with some values of it."""
    return lambda attribute, rng: _retyped(attribute, kind, _KINDS[kind])


def mistyped(attribute: Any, rng: random.Random) -> None:
    """Give the attribute a value that is not of its type: a stronger layer declares the type, as `declared` has it."""
    kind = attribute.typeName
    attribute.layer.customLayerData = {"path": str(attribute.path), "type": str(kind)}
    texts = kind.type.typeName in ("string", "token", "VtArray<string>", "VtArray<TfToken>")
    wrong = rng.choice(("matrix4d[]", "matrix4d") if texts else ("string[]", "matrix4d[]", "string"))
    _retyped(attribute, wrong, _KINDS[wrong])


def declared(layer: Sdf.Layer) -> tuple[str, str] | None:
    """Return the path and type of the attribute that `mistyped` has changed."""
    data = layer.customLayerData
    return (data["path"], data["type"]) if data else None


def interpolation(name: str) -> Change:
    """Return a change of the interpolation."""
    return lambda attribute, rng: attribute.SetInfo("interpolation", name)


def element_size(attribute: Any, rng: random.Random) -> None:
    """Say that several elements make one value."""
    attribute.SetInfo("elementSize", rng.choice((2, 3)))


def word(text: str) -> Change:
    """Return a change of a token, or of one of an array of tokens."""

    def change(attribute: Any, rng: random.Random) -> None:
        if attribute.typeName.isArray:
            values = _elements(attribute)
            values[rng.randrange(len(values))] = text
            _put(attribute, values)
        else:
            attribute.default = text

    return change


def doubled(attribute: Any, rng: random.Random) -> None:
    """Give all values of an array the first one."""
    values = _elements(attribute)
    _put(attribute, [values[0]] * len(values))


def reversed_(attribute: Any, rng: random.Random) -> None:
    """Reverse the order."""
    _put(attribute, _elements(attribute)[::-1])


def filled(value: float) -> Change:
    """Return a change of all numbers to one."""

    def change(attribute: Any, rng: random.Random) -> None:
        if attribute.typeName.isArray:
            _put(attribute, [_filled(each, value) for each in attribute.default])
        else:
            attribute.default = _filled(attribute.default, value)

    return change


def _filled(given: Any, value: float) -> Any:
    if isinstance(given, (float, int)):
        return type(given)(value)
    if isinstance(given, (Gf.Quatf, Gf.Quath)):
        return type(given)(value, value, value, value)
    if isinstance(given, Gf.Matrix4d):
        return Gf.Matrix4d(*[value] * 16)
    return type(given)(*[value] * len(given))


def sample_at(time: float, change: Change) -> Change:
    """Return a change of what an attribute's first time sample has, as a sample at a time."""

    def changed(attribute: Any, rng: random.Random) -> None:
        layer, path = attribute.layer, attribute.path
        attribute.default = layer.QueryTimeSample(path, layer.ListTimeSamplesForPath(path)[0])
        change(attribute, rng)
        value = attribute.default
        attribute.ClearDefaultValue()
        layer.SetTimeSample(path, time, value)

    return changed


def target(path: str) -> Change:
    """Return a change of a relationship's first target, or of an attribute's connection; '' removes all."""

    def change(spec: Any, rng: random.Random) -> None:
        edits = spec.targetPathList if isinstance(spec, Sdf.RelationshipSpec) else spec.connectionPathList
        given = list(edits.explicitItems)
        edits.explicitItems = [Sdf.Path(path), *given[1:]] if path else []

    return change


def own_target(spec: Any, rng: random.Random) -> None:
    """Point a relationship, or a connection, at itself."""
    target(str(spec.path))(spec, rng)


def _numbers(kind: frozenset[str] = REFUSED) -> tuple[Mutation, ...]:
    return tuple(
        Mutation(name, number(value), kind)
        for name, value in (("nan", math.nan), ("inf", math.inf), ("-inf", -math.inf), ("1e30", 1e30))
    )


def _types(*names: str, expected: frozenset[str] = REFUSED, **others: frozenset[str]) -> tuple[Mutation, ...]:
    return tuple(Mutation(f"type {name}", of_type(name), others.get(name.rstrip("[]"), expected)) for name in names)


_NO_ARRAY = ("float", "string", "matrix4d", "bool")
_TEXTS = ("string[]", "token[]", "asset[]", "quatf[]", "matrix4d[]")
_COUNT = (
    Mutation("shorter", shorter, REFUSED, own=False),
    Mutation("longer", longer, REFUSED, own=False),
    Mutation("empty", empty, REFUSED, own=False),
    Mutation("blocked", blocked, REFUSED, own=False),
    Mutation("shorter sample", _sampled(shorter), REFUSED, own=False),
    Mutation("empty sample", _sampled(empty), REFUSED, own=False),
)
_SAME = (Mutation("same sample", same, SOUND),)
_MISTYPED = (Mutation("value of another type", mistyped, REFUSED),)
_NAN = Mutation("nan", number(math.nan), REFUSED)
_FINITE = (_NAN, Mutation("inf", number(math.inf), REFUSED), Mutation("-inf", number(-math.inf), REFUSED))
_VECTORS = (*_numbers(), *_types("int[]", "float[]", "float2[]", "float4[]", *_TEXTS, *_NO_ARRAY), *_SAME, *_MISTYPED)
_FLOATS = (*_numbers(), *_types("float2[]", "float4[]", *_TEXTS, *_NO_ARRAY), *_SAME, *_MISTYPED)
_INTS = (
    Mutation("-1", number(-1), REFUSED),
    Mutation("2^31-1", number(2**31 - 1), REFUSED),
    Mutation("-2^31", number(-(2**31)), REFUSED),
    *_types("float[]", "float2[]", *_TEXTS, *_NO_ARRAY),
    *_SAME,
    *_MISTYPED,
)
_KINDS_OF_PRIMVAR = (
    Mutation("interpolation foo", interpolation("foo"), REFUSED),
    Mutation("interpolation constant", interpolation("constant"), REFUSED),
    Mutation("interpolation ''", interpolation(""), NAMED),
    Mutation("elementSize", element_size, NAMED),
)
_WORD = (
    Mutation("foo", word("foo"), REFUSED),
    Mutation("''", word(""), REFUSED),
    Mutation("'Ünknown\\x1b[31m'", word("Ünknown\x1b[31m"), REFUSED),
    Mutation("500 letters", word("x" * 500), REFUSED),
    *_types("int", "float3", "token[]", "asset", string=HARMLESS),
    Mutation("value of another type", mistyped, HARMLESS),
)
_MISSING = Mutation("missing target", target("/Root/Nowhere"), REFUSED)
_TYPES_OF_SCALAR = _types("string", "float3", "token", "float[]", "asset", "bool")

ROLES: dict[str, tuple[Mutation, ...]] = {
    # Points of a mesh or curves that other attributes follow, and of a mesh that has none.
    "points": (*_VECTORS, *_COUNT),
    "bare": (
        *_VECTORS,
        Mutation("shorter", shorter, REFUSED, own=False),
        Mutation("longer", longer, SOUND),
        Mutation("empty", empty, REFUSED, own=False),
    ),
    "counts": (*_INTS, *_COUNT),
    "indices": (*_INTS, Mutation("beyond", number(64), REFUSED), *_COUNT),
    "fixed_indices": (*_INTS, Mutation("beyond", number(64), REFUSED), *_COUNT[:2]),
    "subset": (*_INTS, Mutation("beyond", number(2), REFUSED), Mutation("longer", longer, SOUND)),
    "holes": (
        Mutation("-1", lambda a, rng: _retyped(a, "int[]", Vt.IntArray([-1])), REFUSED),
        Mutation("beyond", lambda a, rng: _retyped(a, "int[]", Vt.IntArray([6])), REFUSED),
        *_types("float[]", "float2[]", *_TEXTS, *_NO_ARRAY),
        *_SAME,
        *_MISTYPED,
    ),
    "sharpness": (
        _NAN,
        *_types("float2[]", *_TEXTS, *_NO_ARRAY),
        *_COUNT,
        *_SAME,
        *_MISTYPED,
    ),
    "normals": (
        *_FINITE,
        *_VECTORS[4:],
        Mutation("interpolation foo", interpolation("foo"), REFUSED),
        Mutation("longer", longer, REFUSED),
    ),
    "uv": (
        *_FINITE,
        *_types("float[]", "float4[]", *_TEXTS, *_NO_ARRAY, expected=NAMED),
        *_SAME,
        *_MISTYPED,
        Mutation("empty", empty, NAMED),
        Mutation("interpolation foo", interpolation("foo"), REFUSED),
        Mutation("interpolation uniform", interpolation("uniform"), REFUSED),
        Mutation("elementSize", element_size, NAMED),
    ),
    "primvar": (
        *_FINITE,
        *_KINDS_OF_PRIMVAR,
        *_SAME,
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
        Mutation("empty", empty, NAMED),
        Mutation("value of another type", mistyped, NAMED),
    ),
    "color": (
        *_FINITE,
        *_KINDS_OF_PRIMVAR,
        *_types("int[]", "float[]", "float2[]", "float4[]", *_TEXTS, "string", "float", expected=NAMED),
        Mutation("shorter", shorter, REFUSED),
    ),
    "constant": (*_FINITE, Mutation("value of another type", mistyped, NAMED)),
    "inherited": (*_FINITE, Mutation("value of another type", mistyped, NAMED)),
    "unread": (
        *_numbers(SOUND),
        *_types(*_TEXTS, *_NO_ARRAY, expected=SOUND),
        Mutation("blocked", blocked, SOUND),
        Mutation("value of another type", mistyped, SOUND),
    ),
    "velocities": (*_VECTORS, Mutation("shorter", shorter, SOUND), Mutation("blocked", blocked, SOUND)),
    "ignored": (
        *_types(*_TEXTS, *_NO_ARRAY, expected=SOUND),
        Mutation("shorter", shorter, SOUND),
        Mutation("blocked", blocked, SOUND),
    ),
    "token": _WORD,
    "visibility": _WORD,
    "purpose": _WORD,
    "size": (
        Mutation("0", number(0.0), NAMED, own=False),
        Mutation("-1", number(-1.0), REFUSED),
        *_numbers(),
        *_TYPES_OF_SCALAR,
        *_SAME,
        Mutation("value of another type", mistyped, REFUSED),
    ),
    "part": (Mutation("-1", number(-1.0), REFUSED), *_numbers(), *_TYPES_OF_SCALAR),
    "widths": (*_FLOATS, *_COUNT[:2], Mutation("-1", number(-1.0), REFUSED)),
    "width": (*_FLOATS, Mutation("-1", number(-1.0), REFUSED), Mutation("0", number(0.0), NAMED, own=False)),
    "knots": (
        *_FLOATS,
        *_COUNT,
        Mutation("reversed", reversed_, REFUSED, own=False),
        Mutation("doubled", doubled, REFUSED),
    ),
    "ranges": (
        *_numbers(HARMLESS),
        *_types("float[]", *_TEXTS, *_NO_ARRAY),
        Mutation("0", filled(0.0), REFUSED, own=False),
    ),
    "weights": (
        *_FLOATS,
        Mutation("0", number(0.0), REFUSED),
        Mutation("-1", number(-1.0), REFUSED),
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
    ),
    "quaternions": (
        *_numbers(NAMED),
        Mutation("0", filled(0.0), ANY, own=False),
        *_types("float[]", "string[]", "matrix4d[]", "string"),
        Mutation("shorter", shorter, REFUSED),
        *_MISTYPED,
    ),
    "scales": (
        *_numbers(NAMED),
        Mutation("0", filled(0.0), NAMED, own=False),
        *_types("float[]", "float4[]", "string[]", "matrix4d[]", "string"),
        Mutation("shorter", shorter, REFUSED),
        *_MISTYPED,
    ),
    "turn": (
        *_FINITE,
        *_types("string", "float[]", "token", "bool", "asset", expected=NAMED),
    ),
    "uv_indices": (
        *_INTS,
        Mutation("beyond", number(64), REFUSED),
        *_COUNT[:2],
        Mutation("empty", empty, NAMED, own=False),
        Mutation("empty sample", _sampled(empty), NAMED, own=False),
    ),
    "ids": (*_types("float[]", "string[]", "string"), Mutation("shorter", shorter, REFUSED), *_MISTYPED),
    "invisible": (
        *_types("float[]", "string[]", "string"),
        Mutation("longer", longer, SOUND),
        *_MISTYPED,
    ),
    "targets": (
        _MISSING,
        Mutation("no target", target(""), REFUSED, own=False),
        Mutation("itself", own_target, REFUSED),
        Mutation("the parent", target("/Root"), REFUSED, own=False),
        Mutation("not a prim", target("/Root.points"), REFUSED),
    ),
    "target": (
        Mutation("missing target", target("/Root/Nowhere"), REFUSED),
        Mutation("itself", own_target, NAMED, own=False),
        Mutation("another type", target("/Root"), REFUSED),
        Mutation("no target", target(""), NAMED, own=False),
    ),
    "lenient": (
        Mutation("missing target", target("/Root/Nowhere"), NOTED),
        Mutation("another type", target("/Root"), NOTED),
        Mutation("itself", own_target, NAMED, own=False),
    ),
    "placement": (
        *_numbers(NAMED),
        *_types("string", "float[]", "token", "bool", "asset", expected=NAMED),
        *_SAME,
        Mutation("value of another type", mistyped, NAMED),
    ),
    "scale": (
        *_numbers(NAMED),
        Mutation("0", number(0.0), NAMED, own=False),
        *_types("string", "float[]", "matrix4d", expected=NAMED),
    ),
    "order": (
        Mutation("foo", word("foo"), NAMED),
        Mutation("missing operation", word("xformOp:translate:pivot"), NAMED),
        Mutation("''", word(""), NAMED),
        Mutation("operation of another kind", word("xformOp:frobnicate"), NAMED),
        *_types("int[]", "string[]", "float", "token", expected=NAMED),
    ),
    "matrix": (
        _NAN,
        Mutation("inf", number(math.inf), REFUSED),
        *_types("float[]", "string", "float3"),
        *_MISTYPED,
    ),
    "matrices": (
        _NAN,
        Mutation("inf", number(math.inf), REFUSED),
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
        *_types("float[]", "float4[]", "string[]", "string"),
    ),
    "joint_indices": (
        *_INTS,
        Mutation("beyond", number(2), REFUSED),
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
        Mutation("elementSize", lambda a, rng: a.SetInfo("elementSize", rng.choice((-1, 0, 3, 1000))), REFUSED),
        Mutation("interpolation foo", interpolation("foo"), REFUSED),
    ),
    "joint_weights": (
        *_FLOATS,
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
        Mutation("elementSize", lambda a, rng: a.SetInfo("elementSize", rng.choice((-1, 0, 3, 1000))), REFUSED),
        Mutation("interpolation foo", interpolation("foo"), REFUSED),
    ),
    "names": (
        Mutation("shorter", shorter, NAMED, own=False),
        Mutation("longer", longer, NAMED, own=False),
        *_types("int[]", "float", "matrix4d[]"),
        *_MISTYPED,
    ),
    "own_joints": (*_types("int[]", "float", "matrix4d[]"), *_MISTYPED, Mutation("foo", word("foo"), REFUSED)),
    "joints": (
        Mutation("doubled", doubled, REFUSED),
        Mutation("reversed", reversed_, REFUSED),
        Mutation("no path", word("a b/c//"), REFUSED),
        Mutation("''", word(""), REFUSED),
        Mutation("empty", empty, REFUSED),
        Mutation("shorter", shorter, REFUSED, own=False),
        *_types("int[]", "float", "matrix4d[]"),
    ),
    "animated": (
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
        *_types("int[]", "float", "matrix4d[]"),
    ),
    "components": (
        _NAN,
        Mutation("inf", number(math.inf), REFUSED),
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
        Mutation("empty", empty, NOTED),
        *_types("int[]", "float[]", "string[]", "string"),
        *_MISTYPED,
    ),
    "morphs": (
        *_FLOATS,
        Mutation("shorter", shorter, REFUSED),
        Mutation("longer", longer, REFUSED),
    ),
    "offsets": (
        *_numbers(),
        *_types("int[]", "float[]", "float4[]", "string[]", "string"),
        Mutation("shorter", shorter, REFUSED, own=False),
        Mutation("longer", longer, REFUSED, own=False),
    ),
    "binding": (
        Mutation("missing target", target("/Root/Nowhere"), NOTED),
        Mutation("another type", target("/Root"), NOTED),
        Mutation("itself", own_target, NAMED, own=False),
        Mutation("not a prim", target("/Root/Looks/Preview.outputs:surface"), NOTED),
    ),
    "members": (
        Mutation("itself", target("/Root/Body.collection:paint"), REFUSED, own=False),
        Mutation("missing collection", target("/Root/Body.collection:other"), NAMED, own=False),
    ),
    "expansion": (Mutation("foo", word("foo"), NAMED, own=False), *_types("int", "token[]", expected=ANY)),
    "terminal": (
        Mutation("missing target", target("/Root/Nowhere.outputs:surface"), NOTED, own=False),
        Mutation("itself", own_target, NOTED, own=False),
        Mutation("another type", target("/Root/Body.outputs:surface"), NOTED, own=False),
    ),
    "shader": (
        Mutation("foo", word("foo"), NOTED, own=False),
        Mutation("''", word(""), NOTED, own=False),
        Mutation("blocked", blocked, NOTED, own=False),
        *_types("int", "float", "token[]", expected=NOTED | SOUND),
    ),
    "connection": (
        Mutation("missing target", target("/Root/Nowhere.outputs:rgb"), NOTED),
        Mutation("itself", own_target, NOTED),
        Mutation("no prim's output", target("/Root/Looks.outputs:rgb"), NOTED),
        Mutation("an input", target("/Root/Looks/Preview/Surface.inputs:roughness"), NOTED, own=False),
    ),
    "input": (
        Mutation("value of another type", mistyped, NOTED),
        *_types("int[]", "float[]", "matrix4d", expected=NOTED),
    ),
    "varname": (
        Mutation("''", word(""), NOTED),
        *_types("int", "float[]", expected=NAMED),
    ),
    "image": (
        Mutation("missing", lambda a, rng: _retyped(a, "asset", Sdf.AssetPath("nowhere.png")), REFUSED),
        Mutation("a folder", lambda a, rng: _retyped(a, "asset", Sdf.AssetPath("./")), NAMED),
        Mutation("not an image", lambda a, rng: _retyped(a, "asset", Sdf.AssetPath("asset.usda")), NAMED),
        Mutation("no path", lambda a, rng: _retyped(a, "asset", Sdf.AssetPath("")), NAMED | SOUND),
        *_types("int", "float[]", expected=NAMED),
    ),
    "lens": (
        *_numbers(),
        Mutation("0", number(0.0), REFUSED),
        Mutation("-1", number(-1.0), REFUSED),
        *_TYPES_OF_SCALAR,
        Mutation("value of another type", mistyped, REFUSED),
    ),
    "clipping": (
        _NAN,
        Mutation("-inf", number(-math.inf), REFUSED),
        Mutation("0", filled(0.0), REFUSED),
        *_TYPES_OF_SCALAR,
        *_MISTYPED,
    ),
    "number": (*_numbers(), *_TYPES_OF_SCALAR, Mutation("value of another type", mistyped, REFUSED)),
    "sampled": (
        # USD holds a value whose neighbour has another length.
        Mutation("sample at the time shorter", sample_at(3.0, shorter), NAMED, own=False),
        Mutation("sample at the time empty", sample_at(3.0, empty), NAMED, own=False),
    ),
}
