"""The types of Mitsuba and Dr.Jit, only for annotations.

At run time, each variant of Mitsuba has types of its own. They are attributes of the module in that variant, whose type
is `Mitsuba` here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

if TYPE_CHECKING:
    import drjit
    import mitsuba
    from drjit.auto import ad

    AnyArray: TypeAlias = drjit.AnyArray
    Bool: TypeAlias = ad.Bool
    Float: TypeAlias = ad.Float
    UInt: TypeAlias = ad.UInt
    Color3f: TypeAlias = mitsuba.Color3f
    Point3f: TypeAlias = mitsuba.Point3f
    Vector2f: TypeAlias = mitsuba.Vector2f
    Vector3f: TypeAlias = mitsuba.Vector3f
    Vector4f: TypeAlias = mitsuba.Vector4f
    UV: TypeAlias = mitsuba.Point2f | mitsuba.Vector2f
    Ray3f: TypeAlias = mitsuba.Ray3f
    Intersection: TypeAlias = mitsuba.PreliminaryIntersection3f
else:  # Dr.Jit evaluates the annotations of dataclasses at run time, so the names must exist
    AnyArray = Bool = Float = UInt = Color3f = Point3f = Vector2f = Vector3f = Vector4f = UV = Ray3f = object
    Intersection = object


class TracedScene(Protocol):
    """A scene of Mitsuba that intersects rays."""

    def ray_intersect_preliminary(self, ray: Ray3f, *, coherent: bool, active: Bool | bool) -> Intersection: ...

    def ray_test(self, ray: Ray3f, *, coherent: bool, active: Bool) -> Bool: ...


class Mitsuba(Protocol):
    """The module `mitsuba` in a variant: its types and functions that this package uses."""

    Bool: type[ad.Bool]
    Float: type[ad.Float]
    Int32: type[ad.Int]
    UInt32: type[ad.UInt]
    Color3f: type[mitsuba.Color3f]
    Point2f: type[mitsuba.Point2f]
    Point3f: type[mitsuba.Point3f]
    Vector2f: type[mitsuba.Vector2f]
    Vector3f: type[mitsuba.Vector3f]
    Vector3u: type[mitsuba.Vector3u]
    Vector4f: type[mitsuba.Vector4f]
    Ray3f: type[mitsuba.Ray3f]
    BSDF: type[mitsuba.BSDF]
    BSDFFlags: type[mitsuba.BSDFFlags]
    BSDFSample3f: Callable[[], Any]
    Mesh: type[mitsuba.Mesh]
    ParamFlags: type[mitsuba.ParamFlags]
    ShapePtr: type[mitsuba.ShapePtr]
    Texture: type[mitsuba.Texture]
    ScalarTransform4f: Callable[[object], object]
    load_dict: Callable[[dict[str, object]], Any]
    set_variant: Callable[[str], None]
    traverse: Callable[[object], mitsuba.SceneParameters]
    variant: Callable[[], str]
