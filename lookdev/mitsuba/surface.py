"""Surfaces at the hits of rays: the shading frame, and the program of the triangle's look."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeVar

import drjit as dr
import numpy as np

from lookdev.codegen.source import ProgramSource
from lookdev.mitsuba.dual import Dual
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.geometry import Geometry, Hit
from lookdev.mitsuba.images import Images
from lookdev.mitsuba.programs import Evaluation, Program
from lookdev.mitsuba.types import UV, AnyArray, Bool, Color3f, Float, Mitsuba, UInt, Vector3f
from lookdev.rendering.task import SceneTask

Arriving = tuple[Color3f, Color3f]
"""The light that arrives, as two colours: for specular lobes and for diffuse lobes."""

_Result = TypeVar("_Result")


class SceneLooks:
    """The looks of a scene, in a variant's arrays; constants are inputs of kernels, which serve for other values, too.

    `inputs` are values of attributes that are equal everywhere, by the attributes' parameters.
    """

    def __init__(
        self, mi: Mitsuba, task: SceneTask, geometry: Geometry, inputs: Mapping[str, AnyArray] = MappingProxyType({})
    ) -> None:
        self.mi, self.inputs, self.geometry = mi, inputs, geometry
        sources, numbers = _distinct_sources(task)
        self._numbers = device_array(mi.UInt32, numbers)
        self.sources = sources
        self.programs = [_program(mi, source) for source in sources]
        self.images = [{image.name: Images(mi, image) for image in source.look_ups} for source in sources]
        self.transmits = any(source.transmits for source in sources)
        self.see_through = any(source.see_through for source in sources)
        self.deltas = max(source.deltas for source in sources)
        for source in sources:
            for binding in source.attributes:
                if binding.parameter not in self.inputs:
                    geometry.attribute(binding)

    def update(self, task: SceneTask) -> bool:
        """Set the constants to those of another task, and return True, if its sources differ in constants alone.

        Otherwise nothing changes, and False is returned.
        """
        updated, numbers = _distinct_sources(task)
        if numbers != self._numbers.numpy().tolist() or len(updated) != len(self.sources):
            return False
        if any(
            _without_constants(new) != _without_constants(old) for new, old in zip(updated, self.sources, strict=True)
        ):
            return False
        for source, program in zip(updated, self.programs, strict=True):
            for array, value in zip(program.constants, source.constants, strict=True):
                array *= 0.0
                array += value
                dr.make_opaque(array)
        self.sources = updated
        return True

    def program_of(self, triangle: UInt) -> UInt:
        """Return the number of the program of triangles."""
        return dr.gather(self.mi.UInt32, self._numbers, self.geometry.look_of(triangle))


def _distinct_sources(task: SceneTask) -> tuple[list[ProgramSource], list[int]]:
    """Return the sources of a task with different programs, and the number of the program of each of its sources.

    Looks that different lights reach may have the same program.
    """
    distinct = {source.digest: source for source in task.shaders if isinstance(source, ProgramSource)}
    return list(distinct.values()), [list(distinct).index(source.digest) for source in task.shaders]


def _without_constants(source: ProgramSource) -> ProgramSource:
    return replace(source, name="", digest="", constants=(0.0,) * len(source.constants))


def _program(mi: Mitsuba, source: ProgramSource) -> Program:
    constants = [dr.opaque(mi.Float, value) for value in source.constants]
    tables = [device_array(mi.Float, np.load(table.path)) for table in source.tables]
    return Program(source.operations, source.outputs, mi.Float, constants, tables)


class Response:
    """The response to light from a direction: BSDF times cosine, and its diffuse part if `split`.

    `parts` has the same pairs for groups of lobes.
    """

    def __init__(self, whole: tuple[Color3f, Color3f], parts: list[tuple[Color3f, Color3f]], split: bool) -> None:
        self.value, self.diffuse = whole
        self._parts, self._split = parts, split

    def to(self, arriving: Arriving) -> Color3f:
        """Return the reflected light."""
        return self._reflect_light((self.value, self.diffuse), arriving)

    def parts_to(self, arriving: Arriving) -> list[Color3f]:
        """Return the light that each group of lobes reflects."""
        return [self._reflect_light(part, arriving) for part in self._parts]

    def shares(self) -> list[Color3f]:
        """Return the shares of the groups in the value, by channel."""
        safe = dr.select(self.value > 0.0, self.value, 1.0)
        return [dr.select(self.value > 0.0, value / safe, 0.0) for value, _ in self._parts]

    def _reflect_light(self, part: tuple[Color3f, Color3f], arriving: Arriving) -> Color3f:
        value, diffuse = part
        specular_light, diffuse_light = arriving
        if not self._split:
            return value * specular_light
        return value * specular_light + diffuse * (diffuse_light - specular_light)


class SurfacePoints:
    """Points of triangles, seen from `viewer`; its axes are those of `lookdev.scene.shading`, in world space.

    Not a dataclass: Dr.Jit makes dataclasses part of the state of its loops, and loops do not change a surface.
    """

    def __init__(self, looks: SceneLooks, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool) -> None:
        hit = looks.geometry.at(triangle, uv, active)
        self.looks, self.triangle, self.uv, self.viewer, self.active = looks, triangle, uv, viewer, active
        self.point, self.lift = hit.point, hit.lift
        symbols = _Symbols(looks, 0, hit, viewer)
        self._single = Evaluation(looks.programs[0], symbols) if len(looks.programs) == 1 else None
        self.wo = viewer  # axes do not depend on it
        names = ("tangent", "bitangent", "normal", "facet")
        axes = self._call_programs(
            lambda evaluation: [looks.mi.Vector3f(*evaluation.values(name)) for name in names], active=active
        )
        self.wo = symbols.wo = _local(axes, viewer)
        if self._single is not None:
            # Values that do not depend on directions are computed here, outside the loops over directions.
            self._single.prepare("value", "pdf", "wi")
        self.tangent, self.bitangent, self.normal, self.facet = axes

    def to_world(self, w: Vector3f) -> Vector3f:
        return w.x * self.tangent + w.y * self.bitangent + w.z * self.normal

    def to_local(self, w: Vector3f) -> Vector3f:
        return _local((self.tangent, self.bitangent, self.normal), w)

    @property
    def source(self) -> UInt:
        """The number of the source of the triangle's slot; lights are linked with such numbers."""
        return self.looks.geometry.look_of(self.triangle)

    def respond(self, wi: Vector3f, active: Bool, split: bool, groups: Sequence[str]) -> tuple[list[Response], Float]:
        """Return the response to light from local directions, with its derivatives, and the pdf of `draw` for these.

        The response has diffuse parts if light is `split`, and the parts of the `groups` of lobes.
        """
        mi = self.looks.mi

        def respond(evaluation: Evaluation, wi: Vector3f) -> tuple[Float, list[Color3f]]:
            directions = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value = mi.Color3f(*evaluation.values("value", **directions))
            pdf = mi.Float(evaluation.values("pdf", **directions)[0])
            diffuse = mi.Color3f(*evaluation.values("diffuse", **directions)) if split else mi.Color3f(0.0)
            values = [value, diffuse]
            for group in groups:
                part = evaluation.values(f"of_{group}", **directions) if evaluation.has(f"of_{group}") else (0.0,) * 6
                values += [mi.Color3f(*part[:3]), mi.Color3f(*part[3:])]
            return pdf, values

        pdf, (value, diffuse, *parts) = self._call_programs(respond, wi, active=active)
        return [Response((value, diffuse), list(zip(parts[::2], parts[1::2], strict=True)), split)], pdf

    def draw(self, u1: Float, u2: Float, active: Bool) -> Vector3f:
        """Return local directions, sampled from the BSDF."""
        mi = self.looks.mi
        return self._call_programs(
            lambda evaluation, u1, u2: mi.Vector3f(*evaluation.values("wi", u1=u1, u2=u2)), u1, u2, active=active
        )

    def presence(self) -> Float:
        def presence(evaluation: Evaluation) -> Float:
            return self.looks.mi.Float(evaluation.values("presence")[0] if evaluation.has("presence") else 1.0)

        return self._call_programs(presence, active=self.active)

    def absence(self) -> Dual:
        """Return the factor of light that passes straight through the surface, with derivatives."""
        return [self.looks.mi.Color3f(1.0 - self.presence())]

    def delta(self, number: int) -> tuple[Vector3f, Dual, Float]:
        """Return a delta direction (local), the factor of light from there (0 for none), and its group of lobes."""
        mi = self.looks.mi

        def delta(evaluation: Evaluation) -> tuple[Vector3f, Color3f, Float]:
            if not evaluation.has(f"delta{number}"):
                return mi.Vector3f(0.0), mi.Color3f(0.0), mi.Float(0.0)
            values = evaluation.values(f"delta{number}")
            return mi.Vector3f(*values[:3]), mi.Color3f(*values[3:6]), mi.Float(values[6])

        wi, value, group = self._call_programs(delta, active=self.active)
        return wi, [value], group

    def guide(self) -> tuple[Color3f, Vector3f]:
        """Return the albedo and the normal in world space, which guide a denoiser."""
        mi = self.looks.mi

        def guide(evaluation: Evaluation) -> tuple[Color3f, Vector3f]:
            return mi.Color3f(*evaluation.values("albedo")), mi.Vector3f(*evaluation.values("bent"))

        albedo, bent = self._call_programs(guide, active=self.active)
        if self.looks.see_through:
            albedo *= self.presence()
        return albedo, self.to_world(bent)

    def _call_programs(self, function: Callable[..., _Result], *arguments: AnyArray, active: Bool) -> _Result:
        """Call a function with the evaluation of each look's program, on the triangles with that look."""
        if self._single is not None:
            return function(self._single, *arguments)
        looks = self.looks

        def call_of(number: int) -> Callable[..., _Result]:
            def call(
                triangle: UInt, uv: UV, viewer: Vector3f, wo: Vector3f, *arguments: AnyArray, active: Bool
            ) -> _Result:
                symbols = _Symbols(looks, number, looks.geometry.at(triangle, uv, active), viewer)
                symbols.wo = wo
                return function(Evaluation(looks.programs[number], symbols), *arguments)

            return call

        calls = [call_of(number) for number in range(len(looks.programs))]
        program = looks.program_of(self.triangle)
        return dr.switch(program, calls, self.triangle, self.uv, self.viewer, self.wo, *arguments, active=active)


class _Symbols:
    """The values of a program's symbols at points of a surface."""

    def __init__(self, looks: SceneLooks, number: int, hit: Hit, viewer: Vector3f) -> None:
        self.wo: Vector3f | None = None
        self._hit = hit
        self._viewer = viewer
        self._images = looks.images[number]
        self._bindings = {binding.parameter: binding for binding in looks.sources[number].attributes}
        self._uvs = {image.name: image.uv for image in looks.sources[number].look_ups}
        self._values: dict[str, Any] = {"viewer": viewer, **looks.inputs}

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
        return self._hit.handedness if name == "hand" else self._vector(name)

    def _vector(self, name: str) -> Any:
        if name not in self._values:
            self._values[name] = self._read(name)
        return self._values[name]

    def _read(self, name: str) -> Any:
        if name in self._images:
            return self._images[name].texels(self._vector(self._uvs[name]), self._hit._active)
        if name == "mesh_normal":
            return self._hit.normal
        if name == "mesh_facet":
            return self._hit.facet
        return self._hit.attribute(self._bindings["shading_tangent" if name == "mesh_tangent" else name])


def _local(axes: Sequence[Vector3f], w: Vector3f) -> Vector3f:
    tangent, bitangent, normal = axes[:3]
    return type(w)(dr.dot(w, tangent), dr.dot(w, bitangent), dr.dot(w, normal))
