"""Benchmark that shows where a second of rendering goes: it switches off parts of the ``exact`` shader step by step.

A stage is the scene with some parts switched off: one part more than in the stage before it. The time of a part is the
difference between these two stages in the same repeat, so the times of all parts add up to the time of the frame.

The shader is generated from a template with sections, each a group of lines with a name (`lookdev.codegen.templates`).
To switch off a part, the cheapest lines replace the sections of this part. They only set the variables that other
sections read. The compiler then removes code that only this part needs. One effect remains: without rays, no light is
occluded, so code after a ray runs more often. Each stage is rendered in a process of its own. The renders of the stages
are interleaved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise

import numpy as np

from lookdev.bench.benchmark import Benchmark, Spread, TextTable, bullets, render_in_turn
from lookdev.bench.options import Cell
from lookdev.bench.subjects import IBLS, LOOKS, POSE, bench_light, bench_scene
from lookdev.codegen.osl.surface import generate_surface
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import ShaderSource
from lookdev.errors import LookdevError
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.scene import Sampling

FEW_SAMPLES = 2  # samples a pixel of the stage that measures the fixed cost of a frame

# Each stage replaces the sections of one more element; an element maps names of sections to the lines that replace
# them. `wi` is a direction towards the light. Sections that read `wi` are left out before sections that set it, because
# a loop over directions that are all the same computes everything only once.
_SECTIONS: tuple[Mapping[str, tuple[str, ...]], ...] = (
    {"light_lookup": ("radiance = 1;",), "light_density": ("density += 1;",)},
    {
        "evaluate": (
            "color f = 2 + color(wi_x, wi_y, wi_z);",
            "float pdf = 1;",
            "#if LIGHT_SAMPLED",
            "float bsdf_sampled_pdf = 1;",
            "#endif",
        )
    },
    {"light_setup": (), "light_sample": ("wi = n;", "radiance = 1;")},
    {"sample": ("wi_x = 0;", "wi_y = 0;", "wi_z = 1;")},
)
# The shader of a surface that reflects nothing.
_EMPTY = """#include "stdosl.h"
shader lookdev_surface(LOOK_PARAMETERS vector shading_normal = 0, output closure color surface = 0)
{
    surface = emission();
}
"""
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
"""The parts of a frame, in the order in which stages leave them out. The last one is the cost that remains."""


@dataclass(frozen=True)
class Stage:
    """A stage: a scene without the part `part`, which the stage before it still has.

    With `has_few_samples`, the scene is rendered with `FEW_SAMPLES` samples, otherwise with the samples of the options.
    """

    part: str
    scene: SceneTask
    has_few_samples: bool = False


@dataclass(frozen=True)
class CellProfile:
    """The profile of a cell: the median seconds of a frame, and the share of each part, by its name in `PARTS`."""

    scene: str
    ibl: str
    look: str
    seconds: float
    parts: Mapping[str, Spread]


@dataclass(kw_only=True)
class ProfileBenchmark(Benchmark):
    """The benchmark that divides the time of a frame among parts of the shader, of Cycles and of Blender."""

    NAME = "profile"
    FILE = "profile.json"
    ROWS = "cells"
    DEFAULTS = {  # noqa: RUF012
        "scenes": ("sphere", "shaderball"),
        "ibls": ("studio",),
        "looks": ("plastic", "metal", "copper"),
        "backends": ("exact",),
        "samples": (64,),
        "resolution": 96,
        "repeats": 5,
    }

    cells: list[CellProfile] = field(default_factory=list)

    def check(self) -> None:
        """Raise LookdevError for rigs, for several numbers of samples, and for a number of at most `FEW_SAMPLES`."""
        if rigs := [ibl for ibl in self.options.ibls if ibl not in IBLS]:
            raise LookdevError(f"the profile is of maps, not of rigs: {', '.join(rigs)}; known: {', '.join(IBLS)}")
        if len(self.options.samples) != 1 or self.options.samples[0] <= FEW_SAMPLES:
            raise LookdevError(f"the profile is of one number of samples, more than {FEW_SAMPLES}: give --samples 64")

    def measure(self) -> Iterator[None]:
        for cell in self.options.cells():
            try:
                self.cells.append(self._measure_cell(cell))
            except LookdevError as error:
                self.failures.append(f"{cell}: {error}")
                self.report(self.failures[-1])
            yield

    def _measure_cell(self, cell: Cell) -> CellProfile:
        """Return the profile of a cell.

        The last two stages have an empty shader, with all samples and with `FEW_SAMPLES`. From their times the fixed
        cost of Blender is extrapolated linearly to 0 samples.
        """
        options, stages = self.options, stages_of(cell, self.options.resolution)
        samples, repeats = options.samples[0], []

        def task(stage: Stage, repeat: int) -> FrameTask:
            count = FEW_SAMPLES if stage.has_few_samples else samples
            return frame_task(stage.scene, POSE, f"{repeat}", samples=count, seed=repeat)

        for frames in render_in_turn(stages, task, options.repeats, self.open_process):
            repeats.append([frame.seconds for frame in frames])
            self.report(f"{cell}: {repeats[-1][0]:.2f} s, repeat {len(repeats)} of {options.repeats}")
        # Arrays (repeats,) of the seconds of each stage. The last two stages have the empty shader.
        *seconds, empty, few = np.transpose(repeats)
        film = (empty - few) * samples / (samples - FEW_SAMPLES)
        parts = [*(before - after for before, after in pairwise([*seconds, empty])), film, empty - film]
        names = [*(stage.part for stage in stages[1:]), PARTS[-1]]
        shares = {name: Spread.of((part / seconds[0]).tolist()) for name, part in zip(names, parts, strict=True)}
        return CellProfile(**asdict(cell), seconds=float(np.median(seconds[0])), parts=shares)

    def blocks(self) -> Iterator[str | TextTable]:
        options = self.options
        yield from self.header(
            f"{options.resolution} x {options.resolution} pixels, {options.samples[0]} samples, {options.repeats} "
            "repeats, interleaved. Milliseconds of a second of rendering: medians, and in brackets the least and the "
            "most."
        )
        head = ["", *(f"{cell.scene}, {cell.ibl}, {cell.look}" for cell in self.cells)]
        rows = [["seconds of a frame", *(f"{cell.seconds:.3f}" for cell in self.cells)]]
        for part in PARTS:
            shares = [cell.parts.get(part) for cell in self.cells]
            rows.append([part, *("-" if share is None else share.text(_thousandths) for share in shares)])
        yield TextTable(head, rows)
        if self.failures:
            yield bullets(self.failures)


def stages_of(cell: Cell, resolution: int) -> list[Stage]:
    """Return the stages of a cell, the whole frame first; a part that its shader does not have has no stage."""
    look, lights = LOOKS[cell.look].make(), (bench_light(cell.ibl),)
    whole = bench_scene(cell.scene, look, lights, resolution)
    source = whole.shaders[0]
    assert isinstance(source, ShaderSource)
    brdf_samples, ibl_samples = source.directions

    def without_bounces(shadows: bool, left_out: int = 0) -> SceneTask:
        """Return the scene without indirect light, with or without shadow rays, and without some of `_SECTIONS`."""
        lines = {name: section for sections in _SECTIONS[:left_out] for name, section in sections.items()}
        # The numbers of directions are set because their defaults depend on the bounces.
        sampling = Sampling(brdf_samples=brdf_samples, ibl_samples=ibl_samples, bounces=0)
        shader = generate_surface(look, SourceSetting(lights, whole.resolution, sampling, shadows), lines)
        return replace(whole, shaders=(shader,), sampling=replace(whole.sampling, bounces=0))

    bare = [without_bounces(False, left_out) for left_out in range(len(_SECTIONS) + 1)]
    empty = replace(bare[0], shaders=(ShaderSource(look.name, _EMPTY, (), (), f"empty {look.name}"),))
    stages = [Stage("all", whole)]
    for part, scene in zip(PARTS, [without_bounces(source.shadows), *bare, empty], strict=False):
        if scene.shaders[0].digest != stages[-1].scene.shaders[0].digest:
            stages.append(Stage(part, scene))
    return [*stages, Stage(PARTS[-2], empty, has_few_samples=True)]


def _thousandths(share: float) -> str:
    return f"{1000.0 * share:.0f}"
