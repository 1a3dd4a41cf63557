"""The registry of backends: each translates a look to one type of source, and has a worker that renders the source.

A source is generated code, or a tree of shader nodes. Jobs and commands choose a backend by its name in `BACKENDS`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import GeneratedSource, NodeSource, PrincipledSource, ProgramSource, ShaderSource
from lookdev.errors import CodegenError, RenderError
from lookdev.light import Light, light_label, native_gaps
from lookdev.light.lamps import is_plain, rig_faults
from lookdev.rendering.llvm import check_device
from lookdev.rendering.passes import PASSES
from lookdev.space import OCIO_NAMES, REC709, Space

if TYPE_CHECKING:
    from lookdev.material import Look

RENDER_VERSION = 5
"""A number to raise when Cycles backends render the same frame task to other pixels than before."""

NODES_VERSION = 1
"""A number to raise when backend `nodes` alone renders the same frame task to other pixels than before."""

MITSUBA_VERSION = 5
"""A number to raise when `lookdev.mitsuba` renders the same frame task to other pixels than before."""

WORKER_COMMAND: tuple[str, ...] = (sys.executable, "-m", "lookdev.cycles")
"""The command that starts the worker of Cycles: program and arguments."""


@cache
def blender_version() -> str:
    """Return the version of the installed bpy, without importing it."""
    return version("bpy")


def _cycles_version() -> str:
    """Return `Backend.version` of the backends on Cycles."""
    return f"{blender_version()} {RENDER_VERSION}"


def _nodes_version() -> str:
    return f"{_cycles_version()}.{NODES_VERSION}"


def _mitsuba_version() -> str:
    try:
        return f"{version('mitsuba')} {MITSUBA_VERSION}"
    except PackageNotFoundError:
        raise RenderError("backend 'mitsuba' needs Mitsuba 3: pip install 'lookdev[mitsuba]'") from None


@dataclass(frozen=True)
class Backend:
    """One way to render looks: the source that a look is translated to, and the worker that renders it."""

    name: str
    help: str
    source: type[GeneratedSource]  # the type that `generate` returns
    generate: Callable[[Look, SourceSetting], GeneratedSource]  # translates a look; raises CodegenError
    command: tuple[str, ...] = WORKER_COMMAND  # the worker's program and arguments
    devices: tuple[str, ...] = ("cpu",)  # the default first
    look_gap: Callable[[Look], str | None] = lambda look: None  # the reason why it cannot render a look; None if it can
    exact: bool = False  # whether pictures agree with the published models; otherwise they approximate the models
    in_jobs: bool = False  # a job may name the backend
    any_light: bool = False  # renders lights of every kind, by OSL
    light_gaps: Callable[[Sequence[Light]], Sequence[str]] = (
        native_gaps  # returns a reason for each light that it cannot render; not called with `any_light`
    )
    # Estimates the integral of the light over directions that it draws from the look and from the light. Their numbers
    # are `Sampling.brdf_samples` and `ibl_samples`.
    has_light_integral: bool = False
    has_denoising_guides: bool = False  # renders the pictures of albedos and normals that guide a denoiser
    spaces: tuple[Space, ...] = (REC709,)  # the colour spaces in which it can compute light
    passes: tuple[str, ...] = ("samples",)  # the passes that it renders: names in `PASSES`
    can_catch_shadows: bool = False  # renders shadow catchers
    has_isolated_parts: bool = False  # traces no rays between parts of a convex asset: no shadows, no reflections
    can_prepare: bool = False  # its worker can compile a scene before the first frame arrives
    check_device: Callable[[str], None] = lambda device: None  # raises RenderError if this machine lacks the device
    version: Callable[[], str] = _cycles_version  # returns a text that changes when the same task gives other pixels


# Workers import this module to decode tasks, but never generate sources. The following functions therefore import the
# generators only when they are called.
def _generate_exact(look: Look, setting: SourceSetting) -> GeneratedSource:
    from lookdev.codegen.osl.surface import generate_surface

    return generate_surface(look, setting)


def _generate_nodes(look: Look, setting: SourceSetting) -> GeneratedSource:
    from lookdev.codegen.nodes.look import generate_nodes

    return generate_nodes(look, setting.image_file)


def _generate_nodes_exact(look: Look, setting: SourceSetting) -> GeneratedSource:
    from lookdev.codegen.nodes.exact import generate_nodes_exact

    return generate_nodes_exact(look, setting.image_file, bounces=setting.sampling.bounces)


def _generate_program(look: Look, setting: SourceSetting) -> GeneratedSource:
    from lookdev.codegen.program.look import generate_program

    return generate_program(
        look,
        setting.image_file,
        shadows=setting.shadows,
        features=setting.sampling.features,
        space=setting.space,
    )


def _generate_principled(look: Look, setting: SourceSetting) -> GeneratedSource:
    from lookdev.codegen.principled import generate_principled

    return generate_principled(look)


def _lamp_gaps(lights: Sequence[Light]) -> Sequence[str]:
    """Return a sentence for each light that backend `nodes-exact` cannot render: all lamps, and some domes.

    Rays in directions that are sampled from a model pass through lamps. The shader of the world counts the ray portals
    that a ray has passed, to detect rays that left a surface. A lamp on the way is counted like a portal
    (`lookdev.codegen.nodes.exact`).
    """
    lamps = [
        f"{light_label(light, number)}: the rays of this backend find no lamps, only domes"
        for number, light in enumerate(lights, start=1)
        if light.kind != "dome"
    ]
    domes = [light for light in lights if light.kind == "dome"]
    return [*lamps, *native_gaps(domes)]


def _one_dome_gaps(lights: Sequence[Light]) -> Sequence[str]:
    """Return why backend `mitsuba-principled` cannot render lights: the backend renders one plain dome only."""
    if len(lights) == 1 and lights[0].kind == "dome" and is_plain(lights[0]):
        return ()
    return ["the bench lights Mitsuba by one dome alone, in its own axes"]


def _principled_gap(look: Look) -> str | None:
    """Return why a look has no equivalent Principled BSDF, or None if it has one."""
    from lookdev.codegen.principled import generate_principled

    try:
        generate_principled(look)
    except CodegenError as error:
        return str(error)
    return None


_GEOMETRY_PASSES = ("depth", "position", "uv", "samples")
_ANY_DEVICE = ("cpu", "cuda", "optix", "hip", "metal", "oneapi")

BACKENDS: dict[str, Backend] = {
    backend.name: backend
    for backend in (
        Backend(
            name="exact",
            help="the models as published, through light integrals in OSL, which Cycles runs on the CPU only",
            source=ShaderSource,
            generate=_generate_exact,
            exact=True,
            in_jobs=True,
            any_light=True,
            has_light_integral=True,
            has_denoising_guides=True,
            spaces=tuple(OCIO_NAMES),
            passes=tuple(PASSES),
            can_catch_shadows=True,
            has_isolated_parts=True,
            can_prepare=True,
        ),
        Backend(
            name="nodes",
            help="Cycles' own closures, fitted to the models, as native shader nodes",
            source=NodeSource,
            generate=_generate_nodes,
            devices=_ANY_DEVICE,
            in_jobs=True,
            version=_nodes_version,
            passes=tuple(name for name, record in PASSES.items() if not record.light),
        ),
        Backend(
            name="nodes-exact",
            help="the models as published, as native shader nodes without OSL; noisier than exact, and not for looks "
            "that can be seen through",
            source=NodeSource,
            generate=_generate_nodes_exact,
            devices=_ANY_DEVICE,
            exact=True,
            in_jobs=True,
            passes=_GEOMETRY_PASSES,
            light_gaps=_lamp_gaps,
        ),
        Backend(
            name="mitsuba",
            help="the models as published, in Mitsuba 3, which compiles them: faster than exact; pip install "
            "'lookdev[mitsuba]'",
            command=(sys.executable, "-m", "lookdev.mitsuba"),
            source=ProgramSource,
            generate=_generate_program,
            devices=("cpu", "cuda"),
            exact=True,
            in_jobs=True,
            light_gaps=rig_faults,
            has_light_integral=True,
            has_denoising_guides=True,
            passes=tuple(PASSES),
            check_device=check_device,
            has_isolated_parts=True,
            spaces=tuple(OCIO_NAMES),
            version=_mitsuba_version,
        ),
        Backend(
            name="principled",
            help="Blender's Principled BSDF, which comes near to the look, under Cycles' own light",
            source=PrincipledSource,
            generate=_generate_principled,
            devices=_ANY_DEVICE,
            look_gap=_principled_gap,
            has_denoising_guides=True,
        ),
        Backend(
            name="mitsuba-principled",
            help="Mitsuba 3's principled in its LLVM variant, if it is installed: pip install 'lookdev[mitsuba]'",
            command=(sys.executable, "-m", "lookdev.bench.mitsuba_worker"),
            source=PrincipledSource,
            generate=_generate_principled,
            look_gap=_principled_gap,
            light_gaps=_one_dome_gaps,
            has_denoising_guides=True,
            version=lambda: version("mitsuba"),
        ),
    )
}


def job_backends() -> Mapping[str, Backend]:
    """Return the backends that a job may name."""
    return {name: backend for name, backend in BACKENDS.items() if backend.in_jobs}
