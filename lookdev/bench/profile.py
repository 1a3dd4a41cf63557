"""Where a second of rendering goes: parts of the shader of ``exact`` are switched off, one after another.

Each stage leaves out one part more than the stage before it, and what a part takes is the difference of the two in the
same repeat; so the parts add up to the whole frame. Sections of the shader are replaced by the cheapest lines that set
what others read; what only a missing part reads is compiled away with it. Without rays no light is occluded, so that
what follows a ray happens more often. A stage is rendered in a process of its own; stages are interleaved.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from lookdev.bench.backends import POSE, bench_asset, bench_light, bench_scene
from lookdev.bench.document import check_document, markdown, write_section
from lookdev.bench.growth import OpenRenderer, open_process
from lookdev.bench.looks import LOOKS
from lookdev.bench.matrix import IBLS, SCENES, Cell, Options
from lookdev.bench.results import Machine, machine_line, this_machine
from lookdev.cache import atomic_path
from lookdev.codegen.osl.surface import generate_surface
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import ShaderSource
from lookdev.errors import LookdevError
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.scene import Sampling

NAME = "profile"
"""Of the section of the document, and of the file of results."""

FEW = 2  # samples a pixel: what a frame costs beyond its samples is seen by them

Sections = Mapping[str, tuple[str, ...]]

# In the order in which they are left out. What sets `wi` goes after what reads it: a loop whose direction is constant
# computes nothing more than once.
_LOOK_UPS: Sections = {"light_lookup": ("radiance = 1;",), "light_density": ("density += 1;",)}
_EVALUATION: Sections = {
    "evaluate": (
        "color f = 2 + color(wi_x, wi_y, wi_z);",
        "float pdf = 1;",
        "#if LIGHT_SAMPLED",
        "float bsdf_sampled_pdf = 1;",
        "#endif",
    )
}
_LIGHT_DRAWN: Sections = {"light_setup": (), "light_sample": ("wi = n;", "radiance = 1;")}
_BSDF_DRAWN: Sections = {"sample": ("wi_x = 0;", "wi_y = 0;", "wi_z = 1;")}
_EMPTY = """#include "stdosl.h"
shader lookdev_surface(LOOK_PARAMETERS vector shading_normal = 0, output closure color surface = 0)
{
    surface = emission();
}
"""


@dataclass(frozen=True)
class Stage:
    """A scene that lacks a part that the stage before it has, the part's name, whether it has `FEW` samples."""

    part: str
    scene: SceneTask
    few: bool = False


@dataclass(frozen=True)
class CellProfile:
    """Seconds of a frame, and the share of each part of it: medians, and extremes over the repeats."""

    scene: str
    ibl: str
    look: str
    seconds: float
    parts: Mapping[str, tuple[float, float, float]]


@dataclass
class Profile:
    """The shares of all cells so far."""

    machine: Machine = field(default_factory=this_machine)
    restricted: tuple[str, ...] = ()
    cells: list[CellProfile] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    complete: bool = False


PARTS = (
    "indirect light: paths after the first hit",
    "rays towards the light",
    "light: radiance and density along directions",
    "BSDF: evaluation",
    "light: drawing directions",
    "BSDF: drawing directions",
    "shading points: frame, set-up, random numbers",
    "camera rays and film",
    "Blender, whatever the samples",
)
"""By stage."""


def run_profile(
    options: Options,
    folder: Path,
    report: Callable[[str], None],
    *,
    document: Path,
    restricted: tuple[str, ...] = (),
    opened: OpenRenderer = open_process,
) -> Profile:
    """Measure every cell, and write ``profile.json`` to `folder` and the section of the document, also after Ctrl-C.

    Raises LookdevError, before anything is measured, where the document has no place for it, a light is a rig, or the
    options have several counts of samples, or so few that the cost beyond them is not seen.
    """
    check_document(document, NAME)
    if rigs := [each for each in options.ibls if each not in IBLS]:
        raise LookdevError(f"the profile is of maps, not of rigs: {', '.join(rigs)}; known: {', '.join(IBLS)}")
    if len(options.samples) != 1 or options.samples[0] <= FEW:
        raise LookdevError(f"the profile is of one number of samples, more than {FEW}: give --samples 64")
    folder.mkdir(parents=True, exist_ok=True)
    profile = Profile(restricted=restricted)
    try:
        for cell in options.cells():
            try:
                profile.cells.append(_measure(cell, options, report, opened))
            except LookdevError as error:
                profile.failures.append(f"{cell}: {error}")
                report(profile.failures[-1])
        profile.complete = True
    except KeyboardInterrupt:
        pass
    finally:
        with atomic_path(folder / "profile.json") as path:
            path.write_text(json.dumps(asdict(profile), indent=1) + "\n", encoding="utf-8")
        if profile.cells:
            write_section(document, NAME, profile_text(profile, options))
    return profile


def stages(cell: Cell, resolution: int) -> list[Stage]:
    """Return the stages of a cell, the whole frame first; of parts that its shader lacks there is none."""
    asset, look = bench_asset(cell.scene), LOOKS[cell.look].make()
    lights = (bench_light(cell.ibl),)
    whole = bench_scene(asset, look, lights, resolution, SCENES[cell.scene].bounces)
    source = whole.shaders[0]
    assert isinstance(source, ShaderSource)
    brdf_samples, ibl_samples = source.directions

    def without(bounces: int, shadows: bool, *left_out: Sections) -> SceneTask:
        lines = {name: section for each in left_out for name, section in each.items()}
        # Numbers of directions otherwise depend on the bounces.
        sampling = Sampling(brdf_samples=brdf_samples, ibl_samples=ibl_samples, bounces=bounces)
        shader = generate_surface(look, SourceSetting(lights, whole.resolution, sampling, shadows), lines)
        return replace(whole, shaders=(shader,), sampling=replace(whole.sampling, bounces=bounces))

    left_out = (_LOOK_UPS, _EVALUATION, _LIGHT_DRAWN, _BSDF_DRAWN)
    empty = replace(without(0, False), shaders=(ShaderSource(look.name, _EMPTY, (), (), f"empty {look.name}"),))
    scenes = [
        whole,
        without(0, source.shadows),
        *(without(0, False, *left_out[:count]) for count in range(len(left_out) + 1)),
        empty,
    ]
    made = [Stage("all", whole)]
    for part, scene in zip(PARTS, scenes[1:], strict=False):
        if scene.shaders[0].digest != made[-1].scene.shaders[0].digest:
            made.append(Stage(part, scene))
    return [*made, Stage(PARTS[-2], empty, few=True)]


def _measure(cell: Cell, options: Options, report: Callable[[str], None], opened: OpenRenderer) -> CellProfile:
    samples = options.samples[0]
    every = stages(cell, options.resolution)
    seconds: list[list[float]] = []
    with ExitStack() as stack:
        renders = [stack.enter_context(opened()) for _ in every]
        counts = [FEW if each.few else samples for each in every]
        for repeat in range(-1, options.repeats):
            taken = [
                render(frame_task(each.scene, POSE, f"{repeat}", samples=count, seed=repeat + 1)).seconds
                for each, render, count in zip(every, renders, counts, strict=True)
            ]
            if repeat >= 0:  # the first warms up
                seconds.append(list(_shares_of(taken, samples)))
                report(f"{cell}: {taken[0]:.2f} s, repeat {repeat + 1} of {options.repeats}")
    names = [*(each.part for each in every[1:]), PARTS[-1]]
    of_parts = {name: [row[1 + number] / row[0] for row in seconds] for number, name in enumerate(names)}
    shares = {name: (statistics.median(values), min(values), max(values)) for name, values in of_parts.items()}
    return CellProfile(**asdict(cell), seconds=statistics.median(row[0] for row in seconds), parts=shares)


def _shares_of(taken: Sequence[float], samples: int) -> Iterator[float]:
    """Yield the seconds of the whole frame, then of each part.

    The last two frames are of the empty shader, with all samples and with few: along a straight line to none.
    """
    *before, empty, few = taken
    yield taken[0]
    yield from (one - other for one, other in pairwise([*before, empty]))
    film = (empty - few) * samples / (samples - FEW)
    yield from (film, empty - film)


def profile_text(profile: Profile, options: Options) -> str:
    """Return the section: the machine, and a table of the shares, a row a part and a column a cell."""
    blocks = [
        f"{machine_line(profile.machine)}.",
        f"{options.resolution} x {options.resolution} pixels, {options.samples[0]} samples, {options.repeats} repeats, "
        "interleaved. Milliseconds of a second of rendering: medians, and in brackets the least and the most.",
    ]
    if profile.restricted:
        blocks.append(f"A part of the profile: {', '.join(profile.restricted)} are not the defaults.")
    if not profile.complete:
        blocks.append("Not complete: this is what was measured until it ended.")
    head = ["", *(f"{each.scene}, {each.ibl}, {each.look}" for each in profile.cells)]
    rows = [["seconds of a frame", *(f"{each.seconds:.3f}" for each in profile.cells)]]
    rows += [[part, *(_thousandths(each.parts.get(part)) for each in profile.cells)] for part in PARTS]
    blocks.append(markdown(head, rows))
    blocks += [f"- {' '.join(failure.split())}" for failure in profile.failures]
    return "\n\n".join(blocks)


def _thousandths(share: tuple[float, float, float] | None) -> str:
    if share is None:
        return "-"
    middle, low, high = (f"{1000.0 * value:.0f}" for value in share)
    return middle if low == high else f"{middle} ({low}..{high})"
