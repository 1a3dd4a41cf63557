"""The backends: what a look is translated to, and the worker that renders it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from lookdev.codegen import NodeSource, PrincipledSource, ProgramSource, ShaderSource, Source
from lookdev.codegen.setting import SourceSetting
from lookdev.errors import CodegenError, RenderError
from lookdev.light import Light, called, native_gaps
from lookdev.light.lamps import is_plain, not_of_rigs
from lookdev.rendering.llvm import check_device
from lookdev.rendering.passes import PASSES
from lookdev.space import OCIO_NAMES, REC709, Space

if TYPE_CHECKING:
    from lookdev.material import Look

RENDER_VERSION = 5
"""Raised when the program renders the same frame task to other pixels than before."""

NODES_VERSION = 1
"""Raised when backend `nodes` alone does."""

MITSUBA_VERSION = 5
"""Raised when `lookdev.mitsuba` does."""

WORKER_COMMAND: tuple[str, ...] = (sys.executable, "-m", "lookdev.cycles")
"""The worker of Cycles."""


@cache
def blender_version() -> str:
    """Return the version of the installed bpy, without importing it."""
    return version("bpy")


def _of_cycles() -> str:
    return f"{blender_version()} {RENDER_VERSION}"


def _of_nodes() -> str:
    return f"{_of_cycles()}.{NODES_VERSION}"


def _of_mitsuba() -> str:
    try:
        return f"{version('mitsuba')} {MITSUBA_VERSION}"
    except PackageNotFoundError:
        raise RenderError("backend 'mitsuba' needs Mitsuba 3: pip install 'lookdev[mitsuba]'") from None


@dataclass(frozen=True)
class Backend:
    """One way to render looks: the source that a look is translated to, and the worker that takes it."""

    name: str
    help: str
    source: type[Source]
    generate: Callable[[Look, SourceSetting], Source]  # raises CodegenError
    command: tuple[str, ...] = WORKER_COMMAND  # a program that takes tasks of this backend, and its arguments
    devices: tuple[str, ...] = ("cpu",)  # the default first
    cannot_show: Callable[[Look], str | None] = lambda look: None  # the reason, known before a source is generated
    exact: bool = False  # pictures agree with the published models; otherwise they approximate them
    in_jobs: bool = False  # a job may name it
    any_light: bool = False  # renders lights of every kind, by OSL
    cannot_light: Callable[[Sequence[Light]], Sequence[str]] = native_gaps  # what of lights it cannot show, if not any
    directions: bool = False  # uses brdf_samples and ibl_samples of a Sampling
    features: bool = False  # renders what a denoiser is guided by
    spaces: tuple[Space, ...] = (REC709,)  # in which it renders
    passes: tuple[str, ...] = ("samples",)  # of `PASSES`
    catches: bool = False  # renders shadow catchers
    apart: bool = False  # parts of a convex asset neither shadow nor reflect one another
    ahead: bool = False  # its worker takes scenes ahead of their frames, whose compilation takes long
    check_device: Callable[[str], None] = lambda device: None  # raises RenderError if it cannot be had here
    version: Callable[[], str] = _of_cycles  # changes when the same task is rendered to other pixels


# Workers read this registry to decode tasks and generate nothing, so generators are imported where they run.
def _exact(look: Look, setting: SourceSetting) -> Source:
    from lookdev.codegen.osl.surface import generate_surface

    return generate_surface(look, setting)


def _nodes(look: Look, setting: SourceSetting) -> Source:
    from lookdev.codegen.nodes.look import generate_nodes

    return generate_nodes(look, setting.image_file)


def _nodes_exact(look: Look, setting: SourceSetting) -> Source:
    from lookdev.codegen.nodes.exact import generate_nodes_exact

    return generate_nodes_exact(look, setting.image_file, bounces=setting.sampling.bounces)


def _program(look: Look, setting: SourceSetting) -> Source:
    from lookdev.codegen.program.look import generate_program

    return generate_program(
        look,
        setting.image_file,
        shadows=setting.shadows,
        features=setting.sampling.features,
        space=setting.space,
    )


def _principled(look: Look, setting: SourceSetting) -> Source:
    from lookdev.codegen.principled import generate_principled

    return generate_principled(look)


def _only_domes(lights: Sequence[Light]) -> Sequence[str]:
    """Directions drawn from the model pass lamps, and what they pass counts as a portal."""
    lamps = [
        f"{called(each, number)}: the rays of this backend find no lamps, only domes"
        for number, each in enumerate(lights, start=1)
        if each.kind != "dome"
    ]
    domes = [each for each in lights if each.kind == "dome"]
    return [*lamps, *native_gaps(domes)]


def _one_dome(lights: Sequence[Light]) -> Sequence[str]:
    if len(lights) == 1 and lights[0].kind == "dome" and is_plain(lights[0]):
        return ()
    return ["the bench lights Mitsuba by one dome alone, in its own axes"]


def _unlike_principled(look: Look) -> str | None:
    from lookdev.codegen.principled import generate_principled

    try:
        generate_principled(look)
    except CodegenError as error:
        return str(error)
    return None


_PLACES = ("depth", "position", "uv", "samples")
_ANY_DEVICE = ("cpu", "cuda", "optix", "hip", "metal", "oneapi")

BACKENDS: dict[str, Backend] = {
    backend.name: backend
    for backend in (
        Backend(
            name="exact",
            help="the models as published, through light integrals in OSL, which Cycles runs on the CPU only",
            source=ShaderSource,
            generate=_exact,
            exact=True,
            in_jobs=True,
            any_light=True,
            directions=True,
            features=True,
            spaces=tuple(OCIO_NAMES),
            passes=tuple(PASSES),
            catches=True,
            apart=True,
            ahead=True,
        ),
        Backend(
            name="nodes",
            help="Cycles' own closures, fitted to the models, as native shader nodes",
            source=NodeSource,
            generate=_nodes,
            devices=_ANY_DEVICE,
            in_jobs=True,
            version=_of_nodes,
            passes=tuple(name for name, each in PASSES.items() if not each.light),
        ),
        Backend(
            name="nodes-exact",
            help="the models as published, as native shader nodes without OSL; noisier than exact, and not for looks "
            "that can be seen through",
            source=NodeSource,
            generate=_nodes_exact,
            devices=_ANY_DEVICE,
            exact=True,
            in_jobs=True,
            passes=_PLACES,
            cannot_light=_only_domes,
        ),
        Backend(
            name="mitsuba",
            help="the models as published, in Mitsuba 3, which compiles them: faster than exact; pip install "
            "'lookdev[mitsuba]'",
            command=(sys.executable, "-m", "lookdev.mitsuba"),
            source=ProgramSource,
            generate=_program,
            devices=("cpu", "cuda"),
            exact=True,
            in_jobs=True,
            cannot_light=not_of_rigs,
            directions=True,
            features=True,
            passes=tuple(PASSES),
            check_device=check_device,
            apart=True,
            spaces=tuple(OCIO_NAMES),
            version=_of_mitsuba,
        ),
        Backend(
            name="principled",
            help="Blender's Principled BSDF, which comes near to the look, under Cycles' own light",
            source=PrincipledSource,
            generate=_principled,
            devices=_ANY_DEVICE,
            cannot_show=_unlike_principled,
            features=True,
        ),
        Backend(
            name="mitsuba-principled",
            help="Mitsuba 3's principled in its LLVM variant, if it is installed: pip install 'lookdev[mitsuba]'",
            command=(sys.executable, "-m", "lookdev.bench.mitsuba_worker"),
            source=PrincipledSource,
            generate=_principled,
            cannot_show=_unlike_principled,
            cannot_light=_one_dome,
            features=True,
            version=lambda: version("mitsuba"),
        ),
    )
}


def job_backends() -> Mapping[str, Backend]:
    """Return the backends that a job may name."""
    return {name: backend for name, backend in BACKENDS.items() if backend.in_jobs}
