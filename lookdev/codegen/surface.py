"""Whole shaders: a hand-written OSL template with the generated BRDF in it.

A template is a file of `lookdev/shaders`. Lines that consist of ``//@ name`` are replaced by the generated lines
of that name, ``//@ include file`` by that file, so that the text handed to the OSL compiler stands alone.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from lookdev.brdf import PARAMETERS, Bsdf, StackLayer, stack_bsdf
from lookdev.brdf.pixar_layering import Mode
from lookdev.cache import file_digest
from lookdev.codegen.brdf import WI, WO, BrdfCode, emit_brdf, trace_lobes
from lookdev.codegen.graph import Graph
from lookdev.codegen.look import Inputs, look_bsdf
from lookdev.codegen.source import ShaderSource
from lookdev.codegen.symbolic import elements_of, symbol, symbols
from lookdev.errors import CodegenError
from lookdev.material import Bump, Look, Texture


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
    brdf_samples: int,
    ibl_samples: int,
    bounces: int,
    light_size: tuple[int, int],
    light_entries: int,
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
        Directions drawn a shading point from the BRDF and from the light.
    bounces
        Times that light may be reflected by the asset before it leaves it towards the camera.
    light_size, light_entries
        Width and height of the light's table, and the number of its sample entries.
    resolution
        Width and height of the picture in pixels: each pixel has a scramble of its own.
    """
    graph = Graph()
    inputs = Inputs(graph, resolve)
    code = _trace(graph, look_bsdf(look, inputs))
    textures, attributes = inputs.read_by(code.inputs)
    osl = expand_template(
        "surface.osl",
        {
            "constants": [
                f"#define BRDF_SAMPLES {brdf_samples}",
                f"#define IBL_SAMPLES {ibl_samples}",
                f"#define BOUNCES {bounces}",
                f"#define LIGHT_WIDTH {light_size[0]}",
                f"#define LIGHT_HEIGHT {light_size[1]}",
                f"#define LIGHT_ENTRIES {light_entries}",
                f"#define IMAGE_WIDTH {resolution[0]}",
                f"#define IMAGE_HEIGHT {resolution[1]}",
                f"#define TRANSMITS {int(code.transmits)}",
                f"#define SEE_THROUGH {int(code.see_through)}",
            ],
            "parameters": [
                *(f'    string {inputs.textures[name].parameter} = "",' for name in textures),
                *(f"    {_OSL_TYPE[attribute.kind]} {attribute.parameter} = 0," for attribute in attributes),
            ],
            "inputs": [f"    {inputs.code[name]}" for name in textures],
            **_sections(code),
        },
    )
    bound = tuple(inputs.textures[name] for name in textures)
    digest = hashlib.sha256(osl.encode())
    for binding in bound:
        digest.update(file_digest(binding.file).encode())
    for attribute in attributes:
        digest.update(repr(attribute).encode())
    return ShaderSource(look.name, osl, bound, tuple(attributes), digest.hexdigest(), code.transmits, code.see_through)


@dataclass(frozen=True)
class PointLayer:
    """What the code of one layer at listed points depends on: everything else is read from a table."""

    model: str
    tokens: Mapping[str, str]
    mode: Mode = "over"


def generate_points(layers: Sequence[PointLayer], lobes: Sequence[str] | None = None, *, cells: int) -> ShaderSource:
    """Generate the shader that evaluates a stack of layers at listed points: numbers are read from a table.

    A row of the table holds wo, wi, then masks and parameters in the order of `point_columns`. `lobes` restricts the
    stack to some of its lobes, `cells` is the number of three-channel texels that a row takes.
    """
    graph = Graph()
    stack = []
    for number, layer in enumerate(layers):
        parameters: dict[str, object] = dict(layer.tokens)
        for name, parameter in PARAMETERS[layer.model].items():
            if parameter.kind == "float":
                parameters[name] = symbol(graph, f"layer{number}_{name}")
            elif parameter.kind != "token":
                parameters[name] = symbols(graph, [f"layer{number}_{name}_{i}" for i in range(3)])
        stack.append(StackLayer(layer.model, parameters, symbol(graph, f"layer{number}_mask"), layer.mode))
    bsdf = stack_bsdf(stack)
    code = emit_brdf(trace_lobes(graph, bsdf, lambda lobe: lobes is None or lobe.name in lobes))
    columns = point_columns(layers)
    rows = [f"    float {name} = 0;" for name in columns]
    for index in range(0, len(columns), 3):
        rows.append(f"    cell = points_cell(points_file, {index // 3}, number);")
        rows += [f"    {name} = cell[{k}];" for k, name in enumerate(columns[index : index + 3])]
    constants = [
        f"#define POINT_CELLS {cells}",
        f"#define TRANSMITS {int(code.transmits)}",
        f"#define TWO_SIDED {int(bsdf.two_sided)}",
    ]
    osl = expand_template("points.osl", {"constants": constants, "columns": rows, **_sections(code)})
    return ShaderSource("points", osl, (), (), hashlib.sha256(osl.encode()).hexdigest())


def point_columns(layers: Sequence[PointLayer]) -> tuple[str, ...]:
    """Return the columns of a table of points: wo, wi, then of each layer its mask and every number of its inputs."""
    columns = [*WO, *WI]
    for number, layer in enumerate(layers):
        columns.append(f"layer{number}_mask")
        for name, parameter in PARAMETERS[layer.model].items():
            if parameter.kind == "float":
                columns.append(f"layer{number}_{name}")
            elif parameter.kind != "token":
                columns += [f"layer{number}_{name}_{i}" for i in range(3)]
    return tuple(columns)


def _trace(graph: Graph, bsdf: Bsdf) -> BrdfCode:
    return emit_brdf(trace_lobes(graph, bsdf), *elements_of(bsdf.presence))


_OSL_TYPE = {"uv": "vector", "float": "float", "color": "color"}


def _sections(code: BrdfCode) -> dict[str, Sequence[str]]:
    return {"setup": code.setup, "evaluate": code.evaluate, "sample": code.sample}
