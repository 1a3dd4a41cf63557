"""Whole shaders: a hand-written OSL template with the generated BRDF in it.

A template is a file of `lookdev/shaders`. Lines that consist of ``//@ name`` are replaced by the generated lines
of that name, ``//@ include file`` by that file, so that the text handed to the OSL compiler stands alone.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import MODELS, Lobe, Mode, StackLayer, stack_bsdf
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.osl.bsdf import BrdfCode, emit_brdf, trace_lobes
from lookdev.codegen.osl.frame import emit_frame
from lookdev.codegen.osl.inputs import LookUpNames, emit_look_up
from lookdev.codegen.osl.light import light_sections
from lookdev.codegen.source import HANDEDNESS, ShaderSource
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WI, WO, present_lobes
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.errors import CodegenError
from lookdev.light import Light
from lookdev.material import Bump, Look, Texture
from lookdev.material.values import look_bsdf


def expand_template(name: str, sections: Mapping[str, Sequence[str]]) -> str:
    """Fill a template of `lookdev/shaders`; an unknown section is a CodegenError."""
    lines: list[str] = []
    for line in (files("lookdev") / "shaders" / name).read_text(encoding="utf-8").splitlines():
        command = line.strip().removeprefix("//@ ").split() if line.strip().startswith("//@ ") else []
        if command[:1] == ["include"]:
            lines += expand_template(command[1], sections).splitlines()
        elif command:
            if command[0] not in sections:
                raise CodegenError(f"template {name} has no such section: '{command[0]}'")
            lines += sections[command[0]]
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def generate_surface(
    look: Look,
    resolve: Callable[[Texture | Bump], Path],
    *,
    brdf_samples: int | None,
    ibl_samples: int | None,
    bounces: int,
    light: Light,
    shadows: bool = True,
    resolution: tuple[int, int],
) -> ShaderSource:
    """Generate the light integral shader of a look.

    Parameters
    ----------
    look
        Constants in it are folded; lobes that vanish take their textures with them.
    resolve
        Turns a texture into its linear EXR file, a height map into that of its slopes.
    brdf_samples, ibl_samples
        Directions drawn a shading point from the BRDF and from the light; None: as many as suit the look.
    bounces
        Times that light may be reflected by the asset before it leaves it towards the camera.
    light
        The OSL of its kind is part of the shader; of its values, only the constants of `LightCode` are.
    shadows
        The asset may stand in the way of light; without, there are no `bounces` either.
    resolution
        Width and height of the picture in pixels: each pixel has a scramble of its own.
    """
    graph = Graph()
    inputs = Inputs(graph, resolve)
    bsdf = look_bsdf(look, inputs)
    by_light = ibl_samples != 0 and not light.constant
    lobes = present_lobes(graph, bsdf)
    brdf_samples, ibl_samples = _split(lobes, brdf_samples, ibl_samples, bounces, light.constant)
    # At least one: otherwise a path ends.
    onward = max(1, brdf_samples // 4), -(-ibl_samples // 2)
    # Light from behind has directions of its own only where there are two at least.
    from_behind = min(ibl_samples, onward[1]) > 1
    if by_light:
        share = _BROAD_SHARES[bounces > 0]
        lobes = [replace(lobe, share=lobe.share * share) if lobe.broad else lobe for lobe in lobes]
    traced = trace_lobes(
        graph, lobes, lambda lobe: ibl_samples > 0 and lobe.broad and (from_behind or not lobe.transmits)
    )
    names = LookUpNames(inputs)
    code = emit_brdf(traced, elements_of(bsdf.presence)[0], spell=names.spell)
    attributes = inputs.read_by(code.inputs)
    leaning = any(each.attribute == HANDEDNESS for each in attributes)
    emitted = [emit_look_up(name, inputs.look_up(source)) for source, name in names.given.items()]
    bound = tuple(binding for _, bindings in emitted for binding in bindings)
    osl = expand_template(
        "surface.osl",
        {
            "constants": [
                f"#define IBL_SAMPLES {ibl_samples}",
                *_counts("", brdf_samples, ibl_samples, code.transmits),
                *_counts("_ONWARD", *onward, code.transmits),
                f"#define AIDED {int(code.aids)}",
                f"#define BOUNCES {bounces}",
                f"#define SHADOWS {int(shadows)}",
                f"#define IMAGE_WIDTH {resolution[0]}",
                f"#define IMAGE_HEIGHT {resolution[1]}",
                f"#define TRANSMITS {int(code.transmits)}",
                f"#define SEE_THROUGH {int(code.see_through)}",
                *light.code(sampled=ibl_samples > 0).constants,
                f"#define LEANING {int(leaning)}",
            ],
            "parameters": [
                *(f'    string {binding.parameter} = "",' for binding in bound),
                *(f"    {_OSL_TYPE[attribute.kind]} {attribute.parameter} = 0," for attribute in attributes),
            ],
            "frame": emit_frame(leaning=leaning),
            "inputs": [f"    {line}" for lines, _ in emitted for line in lines],
            **_sections(code),
            **light_sections(light),
        },
    )
    digest = hashlib.sha256(osl.encode())
    for binding in bound:
        digest.update(binding.file.digest.encode())
    for attribute in attributes:
        digest.update(repr(attribute).encode())
    return ShaderSource(
        look.name,
        osl,
        bound,
        tuple(attributes),
        digest.hexdigest(),
        code.transmits,
        code.see_through,
        (brdf_samples, ibl_samples),
        shadows,
    )


def _counts(where: str, brdf_samples: int, ibl_samples: int, transmits: bool) -> list[str]:
    """Define how many directions there are; those of the light are divided among front and back."""
    back = ibl_samples // 2 if transmits else 0
    return [
        f"#define BRDF_SAMPLES{where} {brdf_samples}",
        f"#define FRONT_SAMPLES{where} {ibl_samples - back}",
        f"#define BACK_SAMPLES{where} {back}",
    ]


# Directions of the light do for a broad lobe, but they do not find what the asset itself sends: without and with
# bounces. Measured: less is not better.
_BROAD_SHARES = (0.05, 0.3)


def _split(
    lobes: Sequence[Lobe], brdf_samples: int | None, ibl_samples: int | None, bounces: int, constant_light: bool
) -> tuple[int, int]:
    """Choose how many directions come from the BRDF and how many from the light, where they are None."""
    if constant_light:
        # Every direction is equally bright, so samples of the light reduce no variance, even if they are asked for.
        return brdf_samples or 4, 0
    chosen = (0, 4) if bounces == 0 and all(lobe.broad for lobe in lobes) else (4, 4)
    brdf, ibl = (
        own if given is None else given for given, own in zip((brdf_samples, ibl_samples), chosen, strict=True)
    )
    # Keep at least one sampling strategy.
    return (brdf, ibl) if brdf + ibl else (1, 0)


@dataclass(frozen=True)
class PointLayer:
    """What the code of one layer at listed points depends on.

    `constants` has the numbers that are the same at every point: they fold as in the shader of a look. Everything else
    is read from a table.
    """

    model: str
    tokens: Mapping[str, str]
    mode: Mode = "over"
    constants: Mapping[str, float | Sequence[float]] = field(default_factory=dict)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape at one point, () or (3,), of the mask and of every number of the inputs, by name."""
        numbers = [parameter for parameter in MODELS[self.model].parameters.values() if parameter.kind != "token"]
        return {"mask": ()} | {number.name: () if number.kind == "float" else (3,) for number in numbers}


def generate_points(layers: Sequence[PointLayer], lobes: Sequence[str] | None = None) -> ShaderSource:
    """Generate the shader that evaluates a stack of layers at listed points: numbers are read from a table.

    A row of the table holds wo, wi, then masks and parameters in the order of `point_columns`, in `point_cells` texels
    of three channels. `lobes` restricts the stack to some of its lobes.
    """
    graph = Graph()
    stack = []
    for number, layer in enumerate(layers):
        values: dict[str, Any] = dict(layer.tokens)
        for name, shape in layer.shapes().items():
            place = f"layer{number}_{name}"
            if name in layer.constants:
                values[name] = np.asarray(layer.constants[name], dtype=np.float64)
            else:
                values[name] = symbols(graph, [f"{place}_{i}" for i in range(3)]) if shape else symbol(graph, place)
        mask = values.pop("mask")
        stack.append(StackLayer(layer.model, values, mask, layer.mode))
    bsdf = stack_bsdf(stack)
    kept = [lobe for lobe in present_lobes(graph, bsdf) if lobes is None or lobe.name in lobes]
    code = emit_brdf(trace_lobes(graph, kept))
    columns = point_columns(layers)
    rows = [f"    float {name} = 0;" for name in columns]
    for index in range(0, len(columns), 3):
        rows.append(f"    cell = points_cell(points_file, {index // 3}, number);")
        rows += [f"    {name} = cell[{k}];" for k, name in enumerate(columns[index : index + 3])]
    constants = [
        f"#define POINT_CELLS {point_cells(layers)}",
        f"#define TRANSMITS {int(code.transmits)}",
        f"#define TWO_SIDED {int(bsdf.two_sided)}",
    ]
    osl = expand_template("points.osl", {"constants": constants, "columns": rows, **_sections(code)})
    return ShaderSource("points", osl, (), (), hashlib.sha256(osl.encode()).hexdigest(), code.transmits)


def point_columns(layers: Sequence[PointLayer]) -> tuple[str, ...]:
    """Return the columns of a table of points: wo, wi, then what varies of each layer, its mask and its inputs."""
    columns = [*WO, *WI]
    for number, layer in enumerate(layers):
        for name, shape in layer.shapes().items():
            if name not in layer.constants:
                place = f"layer{number}_{name}"
                columns += [f"{place}_{i}" for i in range(3)] if shape else [place]
    return tuple(columns)


def point_cells(layers: Sequence[PointLayer]) -> int:
    """Return how many texels of three channels a row of a table of points takes.

    A power of two: then texel centres are exact in float32, and a look-up that always interpolates returns the texel.
    """
    return 1 << (-(-len(point_columns(layers)) // 3) - 1).bit_length()


_OSL_TYPE = {"uv": "vector", "float": "float", "color": "color"}


def _sections(code: BrdfCode) -> dict[str, Sequence[str]]:
    return {"setup": code.setup, "evaluate": code.evaluate, "sample": code.sample}
