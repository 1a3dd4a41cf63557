"""Whole shaders: a hand-written OSL template with the generated BRDF in it.

A template is a file of `lookdev/shaders`. Lines that consist of ``//@ name`` are replaced by the generated lines
of that name, ``//@ include file`` by that file, so that the text handed to the OSL compiler stands alone.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from lookdev.brdf import LOBES, PARAMETERS, Lobe
from lookdev.cache import file_digest
from lookdev.codegen.brdf import BrdfCode, emit_brdf, trace_lobes
from lookdev.codegen.graph import Graph
from lookdev.codegen.look import Inputs, look_lobes
from lookdev.codegen.source import ShaderSource
from lookdev.codegen.symbolic import symbol, symbols
from lookdev.errors import CodegenError
from lookdev.material import Look, Texture


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
    resolve: Callable[[Texture], Path],
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
        Turns a texture into its linear EXR file.
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
    code = emit_brdf(trace_lobes(graph, look_lobes(look, inputs)))
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
    return ShaderSource(look.name, osl, bound, tuple(attributes), digest.hexdigest())


def generate_points(
    model: str, tokens: Mapping[str, str], lobes: Sequence[str] | None = None, *, cells: int
) -> ShaderSource:
    """Generate the shader that evaluates a model at listed points: every float and colour read from a table.

    A row of the table holds wo, wi, then the parameters in the order of `point_columns`. `lobes` restricts the
    model to some of its lobes, `cells` is the number of three-channel texels that a row takes.
    """
    graph = Graph()
    columns = point_columns(model)
    parameters: dict[str, object] = {}
    for parameter in PARAMETERS[model].values():
        if parameter.kind == "token":
            parameters[parameter.name] = tokens[parameter.name]
        elif parameter.kind == "color":
            parameters[parameter.name] = symbols(graph, [f"p_{parameter.name}_{c}" for c in "rgb"])
        else:
            parameters[parameter.name] = symbol(graph, f"p_{parameter.name}")
    chosen: list[Lobe] = [lobe for lobe in LOBES[model](parameters) if lobes is None or lobe.name in lobes]
    code = emit_brdf(trace_lobes(graph, chosen))
    rows = [f"    float {name} = 0;" for name in columns]
    for index in range(0, len(columns), 3):
        rows.append(f"    cell = points_cell(points_file, {index // 3}, number);")
        rows += [f"    {name} = cell[{k}];" for k, name in enumerate(columns[index : index + 3])]
    constants = [f"#define POINT_CELLS {cells}"]
    osl = expand_template("points.osl", {"constants": constants, "columns": rows, **_sections(code)})
    return ShaderSource(f"{model}_points", osl, (), (), hashlib.sha256(osl.encode()).hexdigest())


def point_columns(model: str) -> tuple[str, ...]:
    """Return the columns of a table of points for a model: wo, wi, then every float and colour channel."""
    columns = ["wo_x", "wo_y", "wo_z", "wi_x", "wi_y", "wi_z"]
    for parameter in PARAMETERS[model].values():
        if parameter.kind == "float":
            columns.append(f"p_{parameter.name}")
        elif parameter.kind == "color":
            columns += [f"p_{parameter.name}_{channel}" for channel in "rgb"]
    return tuple(columns)


_OSL_TYPE = {"uv": "vector", "float": "float", "color": "color"}


def _sections(code: BrdfCode) -> dict[str, Sequence[str]]:
    return {"setup": code.setup, "evaluate": code.evaluate, "sample": code.sample}
