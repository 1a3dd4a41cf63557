"""What a ray has hit: the shading frame, and the look's program there, of whichever look the triangle wears."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from lookdev.codegen import ProgramSource
from lookdev.mitsuba.dual import Dual
from lookdev.mitsuba.frozen import held
from lookdev.mitsuba.geometry import Geometry, Hit
from lookdev.mitsuba.images import Images
from lookdev.mitsuba.programs import Place, Program

Arriving = tuple[Any, Any]
"""Two colours: what specular and what diffuse lobes reflect of."""


class Looks:
    """The looks of a scene, in a variant's arrays. Constants are inputs of kernels, which looks of one text share.

    `inputs` are attributes, by their parameters, that have one value at all places.
    """

    def __init__(
        self, mi: Any, sources: Sequence[ProgramSource], geometry: Geometry, inputs: Mapping[str, Any] | None = None
    ) -> None:
        self.mi = mi
        self.inputs = inputs or {}
        self.geometry = geometry
        # Looks that are lit by different lights may have one program.
        alike = {source.digest: source for source in sources}
        self._numbers = held(mi.UInt32, [list(alike).index(source.digest) for source in sources])
        sources = self.sources = list(alike.values())
        self.programs = [_program(mi, source) for source in sources]
        self.images = [{each.name: Images(mi, each) for each in source.look_ups} for source in sources]
        self.transmits = any(source.transmits for source in sources)
        self.see_through = any(source.see_through for source in sources)
        self.deltas = max(source.deltas for source in sources)
        for source in sources:
            for binding in source.attributes:
                if binding.parameter not in self.inputs:
                    geometry.attribute(binding)

    def take(self, sources: Sequence[ProgramSource]) -> bool:
        """Take the constants of other sources, which kernels read anew; return whether they differ in no more.

        Where they do, nothing changes.
        """
        alike = {source.digest: source for source in sources}
        numbers = [list(alike).index(source.digest) for source in sources]
        if numbers != self._numbers.numpy().tolist() or len(alike) != len(self.sources):
            return False
        made = list(alike.values())
        if any(_text(one) != _text(other) for one, other in zip(made, self.sources, strict=True)):
            return False
        for source, program in zip(made, self.programs, strict=True):
            for array, value in zip(program.constants, source.constants, strict=True):
                array *= 0.0
                array += value
                dr.make_opaque(array)
        self.sources = made
        return True

    def program_of(self, triangle: Any) -> Any:
        """Return the number of the program of triangles."""
        return dr.gather(self.mi.UInt32, self._numbers, self.geometry.worn(triangle))


def _text(source: ProgramSource) -> ProgramSource:
    return replace(source, name="", digest="", constants=(0.0,) * len(source.constants))


def _program(mi: Any, source: ProgramSource) -> Program:
    constants = [dr.opaque(mi.Float, value) for value in source.constants]
    tables = [held(mi.Float, np.load(each.path)) for each in source.tables]
    return Program(source.operations, source.outputs, mi.Float, constants, tables)


class Response:
    """What a surface makes of light from a direction: BSDF times cosine, and the diffuse part of that, if `split`.

    `parts` are the same of groups of lobes.
    """

    def __init__(self, whole: tuple[Any, Any], parts: list[tuple[Any, Any]], split: bool) -> None:
        self.value, self.diffuse = whole
        self._parts, self._split = parts, split

    def to(self, arriving: Arriving) -> Any:
        """Return what is reflected of light."""
        return self._reflected((self.value, self.diffuse), arriving)

    def parts_to(self, arriving: Arriving) -> list[Any]:
        """Return what each group of lobes reflects."""
        return [self._reflected(part, arriving) for part in self._parts]

    def shares(self) -> list[Any]:
        """Return the parts of the groups in the value, by channels."""
        safe = dr.select(self.value > 0.0, self.value, 1.0)
        return [dr.select(self.value > 0.0, value / safe, 0.0) for value, _ in self._parts]

    def _reflected(self, part: tuple[Any, Any], arriving: Arriving) -> Any:
        value, diffuse = part
        specular_light, diffuse_light = arriving
        if not self._split:
            return value * specular_light
        return value * specular_light + diffuse * (diffuse_light - specular_light)


class Surface:
    """Places of triangles seen from `viewer`; the axes are those of `lookdev.scene.shading`, vectors of the world.

    It is no dataclass: those are state of Dr.Jit's loops, which a surface does not change in.
    """

    def __init__(self, looks: Looks, triangle: Any, uv: Any, viewer: Any, active: Any) -> None:
        mi, hit = looks.mi, looks.geometry.at(triangle, uv, active)
        self.looks, self.triangle, self.uv, self.viewer, self.active = looks, triangle, uv, viewer, active
        self.point, self.lift = hit.point, hit.lift
        self._alone: Place | None = None
        if len(looks.programs) == 1:
            symbols = _Symbols(looks, 0, hit, viewer)
            place = self._alone = Place(looks.programs[0], symbols)
            axes = _axes(mi, place)
            self.wo = symbols.wo = _local(axes, viewer)
            # Loops over directions read from outside what does not depend on them.
            place.prepare("value", "pdf", "wi")
        else:

            def axes_of(number: int) -> Callable[..., Any]:
                def axes(triangle: Any, uv: Any, viewer: Any, *, active: Any) -> Any:
                    here = looks.geometry.at(triangle, uv, active)
                    return _axes(mi, Place(looks.programs[number], _Symbols(looks, number, here, viewer)))

                return axes

            calls = [axes_of(number) for number in range(len(looks.programs))]
            axes = dr.switch(looks.program_of(triangle), calls, triangle, uv, viewer, active=active)
            self.wo = _local(axes, viewer)
        self.tangent, self.bitangent, self.normal, self.facet = axes

    def to_world(self, w: Any) -> Any:
        return w.x * self.tangent + w.y * self.bitangent + w.z * self.normal

    def to_local(self, w: Any) -> Any:
        return _local((self.tangent, self.bitangent, self.normal), w)

    @property
    def source(self) -> Any:
        """The number of what is worn: of the source, which is lit by lights of its own."""
        return self.looks.geometry.worn(self.triangle)

    def respond(self, wi: Any, active: Any, split: bool, groups: Sequence[str]) -> tuple[list[Response], Any]:
        """Return the response to light from local directions, with its derivatives, and the pdf of `draw` there.

        The diffuse parts are wanted if light is `split`, and what lobes of some `groups` reflect.
        """
        mi = self.looks.mi

        def respond(place: Place, wi: Any) -> tuple[Any, ...]:
            given = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value, pdf = mi.Color3f(*place.values("value", **given)), mi.Float(place.values("pdf", **given)[0])
            diffuse = mi.Color3f(*place.values("diffuse", **given)) if split else mi.Color3f(0.0)
            found = [value, diffuse]
            for group in groups:
                part = place.values(f"of_{group}", **given) if place.has(f"of_{group}") else (0.0,) * 6
                found += [mi.Color3f(*part[:3]), mi.Color3f(*part[3:])]
            return pdf, *found

        pdf, value, diffuse, *parts = self._called(respond, wi, active=active)
        return [Response((value, diffuse), list(zip(parts[::2], parts[1::2], strict=True)), split)], pdf

    def draw(self, u1: Any, u2: Any, active: Any) -> Any:
        """Draw local directions."""
        mi = self.looks.mi
        return self._called(lambda place, u1, u2: mi.Vector3f(*place.values("wi", u1=u1, u2=u2)), u1, u2, active=active)

    def presence(self) -> Any:
        mi = self.looks.mi

        def presence(place: Place) -> Any:
            return mi.Float(place.values("presence")[0]) if place.has("presence") else mi.Float(1.0)

        return self._called(presence, active=self.active)

    def absence(self) -> Dual:
        """Return what light from behind is multiplied by, with derivatives."""
        return [self.looks.mi.Color3f(1.0 - self.presence())]

    def delta(self, number: int) -> tuple[Any, Dual, Any]:
        """Return a single direction, local, what light from there is multiplied by, 0 for none, and its group."""
        mi = self.looks.mi

        def delta(place: Place) -> tuple[Any, Any, Any]:
            if not place.has(f"delta{number}"):
                return mi.Vector3f(0.0), mi.Color3f(0.0), mi.Float(0.0)
            found = place.values(f"delta{number}")
            return mi.Vector3f(*found[:3]), mi.Color3f(*found[3:6]), mi.Float(found[6])

        wi, value, group = self._called(delta, active=self.active)
        return wi, [value], group

    def guide(self) -> tuple[Any, Any]:
        """Return albedo and normal, of the world, for a denoiser."""
        mi = self.looks.mi

        def guide(place: Place) -> tuple[Any, Any]:
            return mi.Color3f(*place.values("albedo")), mi.Vector3f(*place.values("bent"))

        albedo, bent = self._called(guide, active=self.active)
        if self.looks.see_through:
            albedo *= self.presence()
        return albedo, self.to_world(bent)

    def _called(self, function: Callable[..., Any], *arguments: Any, active: Any) -> Any:
        """Call a function of the place of each look, where triangles wear it."""
        if self._alone is not None:
            return function(self._alone, *arguments)
        looks = self.looks

        def of(number: int) -> Callable[..., Any]:
            def call(triangle: Any, uv: Any, viewer: Any, wo: Any, *arguments: Any, active: Any) -> Any:
                symbols = _Symbols(looks, number, looks.geometry.at(triangle, uv, active), viewer)
                symbols.wo = wo
                return function(Place(looks.programs[number], symbols), *arguments)

            return call

        calls = [of(number) for number in range(len(looks.programs))]
        worn = looks.program_of(self.triangle)
        return dr.switch(worn, calls, self.triangle, self.uv, self.viewer, self.wo, *arguments, active=active)


class _Symbols:
    """The values of a program's symbols at places."""

    def __init__(self, looks: Looks, number: int, hit: Hit, viewer: Any) -> None:
        self.wo: Any = None
        self._hit = hit
        self._viewer = viewer
        self._images = looks.images[number]
        self._bindings = {each.parameter: each for each in looks.sources[number].attributes}
        self._uvs = {each.name: each.uv for each in looks.sources[number].look_ups}
        self._known: dict[str, Any] = {"viewer": viewer, **looks.inputs}

    def __call__(self, name: str) -> Any:
        if name.startswith("wo_"):
            return getattr(self.wo, name[-1])
        source, _, index = name.partition("[")
        if index:
            return self._vector(source)[int(index[:-1])]
        if name.endswith("_a") and name[:-2] in self._images:
            return self._vector(name[:-2])[3]
        if name == "inside":
            return dr.select(
                dr.dot(self._hit.normal, self._hit.facet) * dr.dot(self._hit.facet, self._viewer) < 0, 1.0, 0.0
            )
        return self._hit.hand if name == "hand" else self._vector(name)

    def _vector(self, name: str) -> Any:
        if name not in self._known:
            self._known[name] = self._found(name)
        return self._known[name]

    def _found(self, name: str) -> Any:
        if name in self._images:
            return self._images[name].texels(self._vector(self._uvs[name]), self._hit._active)
        if name == "mesh_normal":
            return self._hit.normal
        if name == "mesh_facet":
            return self._hit.facet
        return self._hit.attribute(self._bindings["shading_tangent" if name == "mesh_tangent" else name])


def _axes(mi: Any, place: Place) -> tuple[Any, Any, Any, Any]:
    tangent, bitangent, normal, facet = (
        mi.Vector3f(*place.values(name)) for name in ("tangent", "bitangent", "normal", "facet")
    )
    return tangent, bitangent, normal, facet


def _local(axes: Sequence[Any], w: Any) -> Any:
    tangent, bitangent, normal = axes[:3]
    return type(w)(dr.dot(w, tangent), dr.dot(w, bitangent), dr.dot(w, normal))
