"""Surfaces at the hits of rays: the shading frame there, and the BSDF of the triangle's look.

A look is a program (`lookdev.mitsuba.programs`), which computes the frame, the response to light, and sampled
directions. In this module, `wi` is the direction of light and `wo` is the direction to the viewer, both in the shading
frame; `w` is a direction in world space. A delta direction is a single direction of light to which the BSDF responds,
such as the direction of a mirror reflection.
"""

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
    """The looks of a scene in a variant's arrays.

    Constants of looks are inputs of kernels, so a kernel need not be compiled again if they change. `inputs` has the
    values of attributes that are the same everywhere, by `AttributeBinding.parameter`.

    Attributes
    ----------
    sources, programs, images
        Lists with an entry for each distinct program: its source, the program, and its images by name.
    transmits, see_through
        Whether some look transmits light, and whether the presence of some look is below 1.
    deltas
        The most delta directions of a look.
    """

    def __init__(
        self, mi: Mitsuba, task: SceneTask, geometry: Geometry, inputs: Mapping[str, AnyArray] = MappingProxyType({})
    ) -> None:
        self.mi, self.inputs, self.geometry = mi, inputs, geometry
        sources, numbers = _distinct_sources(task)
        self._numbers = device_array(mi.UInt32, numbers)  # the number of the program of each source of the task
        self.sources = sources
        self.programs = [_program(mi, source) for source in sources]
        self.images = [{image.name: Images(mi, image) for image in source.look_ups} for source in sources]
        self.transmits = any(source.transmits for source in sources)
        self.see_through = any(source.see_through for source in sources)
        self.deltas = max(source.deltas for source in sources)
        # Load the attributes that the programs read.
        for source in sources:
            for binding in source.attributes:
                if binding.parameter not in self.inputs:
                    geometry.attribute(binding)

    def update(self, task: SceneTask) -> bool:
        """Change to the constants of another task, if its sources differ only in constants; return whether they do.

        Otherwise nothing changes.
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
        """Return the numbers of the programs of triangles."""
        return dr.gather(self.mi.UInt32, self._numbers, self.geometry.look_of(triangle))


def _distinct_sources(task: SceneTask) -> tuple[list[ProgramSource], list[int]]:
    """Return the sources of a task without duplicates, and the number of each source of the task among them.

    A task has duplicates where different lights reach slots with the same look.
    """
    distinct = {source.digest: source for source in task.shaders if isinstance(source, ProgramSource)}
    return list(distinct.values()), [list(distinct).index(source.digest) for source in task.shaders]


def _without_constants(source: ProgramSource) -> ProgramSource:
    """Return a source without name and digest, and with 0 for all constants."""
    return replace(source, name="", digest="", constants=(0.0,) * len(source.constants))


def _program(mi: Mitsuba, source: ProgramSource) -> Program:
    """Return the program of a source. Its constants are opaque, so that kernels read them as inputs."""
    constants = [dr.opaque(mi.Float, value) for value in source.constants]
    tables = [device_array(mi.Float, np.load(table.path)) for table in source.tables]
    return Program(source.operations, source.outputs, mi.Float, constants, tables)


class Response:
    """The response of a surface to light from a direction.

    `whole` is a pair: the BSDF times the cosine, and the part of this product from diffuse lobes. The diffuse part
    counts only if `split`, which means that diffuse and specular lobes receive different light. `parts` has such a pair
    for each group of lobes.
    """

    def __init__(self, whole: tuple[Color3f, Color3f], parts: list[tuple[Color3f, Color3f]], split: bool) -> None:
        self.value, self.diffuse = whole
        self._parts, self._split = parts, split

    def to(self, arriving: Arriving) -> Color3f:
        """Return the light that the surface reflects, from the light that arrives."""
        return self._reflect_light((self.value, self.diffuse), arriving)

    def parts_to(self, arriving: Arriving) -> list[Color3f]:
        """Return the light that each group of lobes reflects."""
        return [self._reflect_light(part, arriving) for part in self._parts]

    def shares(self) -> list[Color3f]:
        """Return the share of each group of lobes in the value, by channel; 0 where the value is 0."""
        safe = dr.select(self.value > 0.0, self.value, 1.0)
        return [dr.select(self.value > 0.0, value / safe, 0.0) for value, _ in self._parts]

    def _reflect_light(self, part: tuple[Color3f, Color3f], arriving: Arriving) -> Color3f:
        """Return the reflected light; `part` is a pair of a BSDF times the cosine, and its diffuse part."""
        value, diffuse = part
        specular_light, diffuse_light = arriving
        if not self._split:
            return value * specular_light
        return value * specular_light + diffuse * (diffuse_light - specular_light)


class SurfacePoints:
    """Points of triangles, seen from directions `viewer`.

    `uv` are barycentric coordinates. The axes tangent, bitangent, normal and facet are those of
    `lookdev.scene.shading`, in world space.

    The class is not a dataclass: Dr.Jit makes dataclasses part of the state of its loops, and loops do not change a
    surface.
    """

    def __init__(self, looks: SceneLooks, triangle: UInt, uv: UV, viewer: Vector3f, active: Bool) -> None:
        hit = looks.geometry.at(triangle, uv, active)
        self.looks, self.triangle, self.uv, self.viewer, self.active = looks, triangle, uv, viewer, active
        self.point, self.lift = hit.point, hit.lift
        symbols = _Symbols(looks, 0, hit, viewer)
        self._single = Evaluation(looks.programs[0], symbols) if len(looks.programs) == 1 else None
        # The axes, which do not depend on `wo`, are computed first. Until then, `wo` has a value of the right type.
        self.wo = viewer
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
        """Return directions in world space, from directions in the shading frame."""
        return w.x * self.tangent + w.y * self.bitangent + w.z * self.normal

    def to_local(self, w: Vector3f) -> Vector3f:
        """Return directions in the shading frame, from directions in world space."""
        return _local((self.tangent, self.bitangent, self.normal), w)

    @property
    def source(self) -> UInt:
        """The number of the task's source for the triangle's slot. Light links refer to these numbers."""
        return self.looks.geometry.look_of(self.triangle)

    def respond(self, wi: Vector3f, active: Bool, split: bool, groups: Sequence[str]) -> tuple[list[Response], Float]:
        """Return the response to light from directions in the shading frame, and the pdf with which `draw` draws them.

        Further responses in the list are derivatives of the first response. A response has a diffuse part if light is
        `split`, and a part for each of the `groups` of lobes.
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
        """Return directions in the shading frame, sampled from the BSDF by two uniform numbers."""
        mi = self.looks.mi
        return self._call_programs(
            lambda evaluation, u1, u2: mi.Vector3f(*evaluation.values("wi", u1=u1, u2=u2)), u1, u2, active=active
        )

    def presence(self) -> Float:
        """Return the presence: the share of light that does not pass straight through the surface."""

        def presence(evaluation: Evaluation) -> Float:
            return self.looks.mi.Float(evaluation.values("presence")[0] if evaluation.has("presence") else 1.0)

        return self._call_programs(presence, active=self.active)

    def absence(self) -> Dual:
        """Return the factor of light that passes straight through the surface, a dual: 1 minus the presence."""
        return [self.looks.mi.Color3f(1.0 - self.presence())]

    def delta(self, number: int) -> tuple[Vector3f, Dual, Float]:
        """Return a delta direction in the shading frame, the factor of light from there, and its group of lobes.

        The factor is 0 where the look has no delta direction of this number. The group is an index into `LOBE_GROUPS`.
        """
        mi = self.looks.mi

        def delta(evaluation: Evaluation) -> tuple[Vector3f, Color3f, Float]:
            if not evaluation.has(f"delta{number}"):
                return mi.Vector3f(0.0), mi.Color3f(0.0), mi.Float(0.0)
            values = evaluation.values(f"delta{number}")
            return mi.Vector3f(*values[:3]), mi.Color3f(*values[3:6]), mi.Float(values[6])

        wi, value, group = self._call_programs(delta, active=self.active)
        return wi, [value], group

    def guide(self) -> tuple[Color3f, Vector3f]:
        """Return the albedo, and the normal in world space. Both guide a denoiser."""
        mi = self.looks.mi

        def guide(evaluation: Evaluation) -> tuple[Color3f, Vector3f]:
            return mi.Color3f(*evaluation.values("albedo")), mi.Vector3f(*evaluation.values("bent"))

        albedo, bent = self._call_programs(guide, active=self.active)
        if self.looks.see_through:
            albedo *= self.presence()
        return albedo, self.to_world(bent)

    def _call_programs(self, function: Callable[..., _Result], *arguments: AnyArray, active: Bool) -> _Result:
        """Call a function with the evaluation of the look's program at all points, and return its result.

        If there are several programs, the function is called once for each, and Dr.Jit selects the result at each
        point.
        """
        if self._single is not None:
            return function(self._single, *arguments)
        looks = self.looks

        def call_of(number: int) -> Callable[..., _Result]:
            """Return the call for the points where the look has program `number`."""

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
    """The values of symbols of program `number` at points of a surface; called with a symbol's name.

    Symbols are named as in `ProgramSource`: directions in the shading frame, vectors of the mesh, attributes, images.
    """

    def __init__(self, looks: SceneLooks, number: int, hit: Hit, viewer: Vector3f) -> None:
        self.wo: Vector3f | None = None
        self._hit = hit
        self._viewer = viewer
        self._images = looks.images[number]
        self._bindings = {binding.parameter: binding for binding in looks.sources[number].attributes}
        self._uvs = {image.name: image.uv for image in looks.sources[number].look_ups}
        self._values: dict[str, Any] = {"viewer": viewer, **looks.inputs}

    def __call__(self, name: str) -> Any:
        """Return the value of a symbol, which may be a component of a vector, as ``name[0]``."""
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
        """Return a vector, an attribute or the channels of an image; each is read only once."""
        if name not in self._values:
            self._values[name] = self._read(name)
        return self._values[name]

    def _read(self, name: str) -> Any:
        """Read a vector of the mesh, an attribute or the channels of an image."""
        if name in self._images:
            return self._images[name].texels(self._vector(self._uvs[name]), self._hit._active)
        if name == "mesh_normal":
            return self._hit.normal
        if name == "mesh_facet":
            return self._hit.facet
        return self._hit.attribute(self._bindings["shading_tangent" if name == "mesh_tangent" else name])


def _local(axes: Sequence[Vector3f], w: Vector3f) -> Vector3f:
    """Return the components of a vector along the first three axes."""
    tangent, bitangent, normal = axes[:3]
    return type(w)(dr.dot(w, tangent), dr.dot(w, bitangent), dr.dot(w, normal))
