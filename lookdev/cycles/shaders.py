"""Compiles generated OSL shaders, and builds the materials that use them.

A source is the generated shader of a look. Compiled shaders are cached on disk.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import _cycles
import bpy
import numpy as np
from bpy.types import ShaderNodeScript, ShaderNodeTree

from lookdev.arrays import Floats32, Ints32
from lookdev.cache import Content, cache_dir, cached_file, memory_file
from lookdev.codegen.source import ShaderSource
from lookdev.cycles import version
from lookdev.cycles.nodes import add_node
from lookdev.cycles.streams import capture_output
from lookdev.errors import RenderError
from lookdev.light import Light, RigOrigin, lights_code

AttributeNumbers = Ints32 | Floats32
"""The values of an array parameter of a shader, which `array_text` writes into its compiled code."""

RECORD_PROPERTY = "lookdev_record"
"""The name of a property of Blender's objects that selects the parts of the light that shaders record.

Its value is the numbers of three parts, where 0 means no part (`BlenderScene.select_recorded_parts`).
"""

CAUGHT_PROPERTY = "lookdev_caught"
"""The name of a property of Blender's objects that selects the render of a shadow-catcher frame that shaders show.

Its value is the number of one of the three renders in `lookdev.codegen.osl.catching`, then 0 and 0.
"""

_SOCKETS: dict[type, str] = {str: "NodeSocketString", int: "NodeSocketInt", float: "NodeSocketFloat"}
_ATTRIBUTE_SOCKETS = {
    "uv": "NodeSocketVector",
    "float": "NodeSocketFloat",
    "color": "NodeSocketColor",
    "vector": "NodeSocketVector",
}


def compile_osl(source: ShaderSource) -> Path:
    """Return the compiled .oso file of a shader from the cache; compile it there if it is missing.

    Each text of a shader has a file of its own in the cache. Blender would write the compiled file next to the script,
    where two processes can collide. If the text does not compile, raises RenderError with the compiler's first message
    and the path of a copy of the text.
    """
    text = "\n".join((*version.OSL_DEFINES, *_constant_definitions(source), source.osl))
    name = hashlib.sha256(f"{version.VERSION}\n{text}".encode()).hexdigest()

    def compile_text(compiled: Path) -> None:
        file = compiled.with_suffix(".osl")
        try:
            file.write_text(text, encoding="utf-8")
            with memory_file(compiled) as memory:
                is_compiled, log = capture_output(lambda: _cycles.osl_compile(os.fspath(file), memory))
            if not is_compiled:
                refused = file.replace(cache_dir("osl") / f"{name}.osl")
                message = next((line.partition(f"{file}:")[2] for line in log.splitlines() if str(file) in line), log)
                raise RenderError(f"the shader of '{source.name}' does not compile: {refused}:{message}")
        finally:
            file.unlink(missing_ok=True)

    return cached_file("osl", name, ".oso", compile_text).path


def _constant_definitions(source: ShaderSource) -> list[str]:
    """Return the lines of OSL that define the constants of a look as macros.

    Most constants are numbers in the text. A varying constant (`source.varying`) is an element of a shader parameter of
    type color instead, so that its value can change without a new compilation.
    """
    values = {number: repr(value) for number, value in enumerate(source.constants)}
    values |= {number: f"look_values_{i // 3}[{i % 3}]" for i, number in enumerate(source.varying)}
    parameters = " ".join(f"color look_values_{i} = 0," for i in range(-(-len(source.varying) // 3)))
    return [
        f"#define LOOK_PARAMETERS {parameters}",
        *(f"#define look_{number} {value}" for number, value in values.items()),
    ]


def varying_values(source: ShaderSource, number: int) -> dict[str, tuple[float, ...]]:
    """Return the varying constants of a source as properties of Blender's objects, by name.

    A property has three constants; the last property is padded with 0. `number` is the index of the source among the
    shaders of its scene. The names of the properties contain this number.
    """
    values = [source.constants[i] for i in source.varying]
    values += [0.0] * (-len(values) % 3)
    return {f"look_{number}_{i}": tuple(values[3 * i : 3 * i + 3]) for i in range(len(values) // 3)}


def build_surface_material(
    source: ShaderSource, number: int, lights: Sequence[Light], rig_origin: RigOrigin
) -> bpy.types.Material:
    """Create the material of a look whose shader integrates the light.

    The material reads its varying constants from the properties of objects that `varying_values` names for the same
    `number`. Cycles reads these properties anew for each render, and compiles nothing.
    """
    code = lights_code(lights, sampled=source.directions[1] > 0, rig_origin=rig_origin)
    parameters = {**code.parameters, **{binding.parameter: binding.file for binding in source.textures}}
    values = {name: str(value.path) if isinstance(value, Content) else value for name, value in parameters.items()}
    arrays = {name: _cached_array_text(content) for name, content in code.arrays.items()}
    arrays |= {name: array_text(numbers) for name, numbers in code.numbers.items()}
    material = bpy.data.materials.new(source.name)
    # Cycles must not treat the material as a light, although it emits. Otherwise Cycles would put each triangle with it
    # into a light tree.
    material.cycles.emission_sampling = "NONE"
    tree = version.clear_node_tree(material)
    script = add_script_node(tree, source, values, arrays)
    _link_attribute(tree, script, "shading_normal", "lookdev_normal", "vector")
    for attribute in source.attributes:
        _link_attribute(tree, script, attribute.parameter, attribute.mesh_name, attribute.kind)
    if source.recorded:
        _link_attribute(tree, script, "record", RECORD_PROPERTY, "color", owner="INSTANCER")
    if source.catching:
        _link_attribute(tree, script, "caught", CAUGHT_PROPERTY, "color", owner="INSTANCER")
    for i, name in enumerate(varying_values(source, number)):
        # The instancer is the object that shows the instances, or the object itself.
        _link_attribute(tree, script, f"look_values_{i}", name, "color", owner="INSTANCER")
    return material


def add_script_node(
    tree: ShaderNodeTree,
    source: ShaderSource,
    values: Mapping[str, str | int | float],
    arrays: Mapping[str, str] | None = None,
) -> ShaderNodeScript:
    """Add a script node that runs a shader, with its sockets, and link it to the surface output.

    values : the values of parameters, by name; these parameters become sockets. arrays : the values of array
    parameters, as texts of `array_text`, by name. Arrays have no sockets; they become default values in the compiled
    shader.

    Sockets are added here, because Blender would add them by `oslquery`, which loads an OpenImageIO that clashes with
    the installed OpenImageIO.
    """
    script = tree.nodes.new("ShaderNodeScript")
    compiled = compile_osl(source)
    values, arrays = dict(values), dict(arrays or {})
    for table in source.tables:
        if table.file.suffix == ".npy":
            arrays[table.parameter] = _cached_array_text(table.file)
        else:
            values[table.parameter] = str(table.file.path)
    if arrays:
        script.mode = "INTERNAL"
        script.bytecode = insert_arrays(compiled.read_text(encoding="utf-8"), arrays)
        script.bytecode_hash = hashlib.md5(script.bytecode.encode(), usedforsecurity=False).hexdigest()
    else:
        script.mode = "EXTERNAL"
        script.filepath = str(compiled)
    for name, value in values.items():
        script.inputs.new(type=_SOCKETS[type(value)], name=name, identifier=name).default_value = value
    surface = script.outputs.new(type="NodeSocketShader", name="surface", identifier="surface")
    add_node(tree, "OutputMaterial", {"Surface": surface}, target="CYCLES")
    return script


def array_text(values: AttributeNumbers) -> str:
    """Return an array as the text that a compiled shader has: type and size, a tab, and the numbers."""
    listed = values.ravel().tolist()
    if values.dtype.kind == "i":
        # To format the whole list takes half the time of joining its numbers.
        return f"int[{values.size}]\t{str(listed)[1:-1].replace(',', '')}"
    return f"float[{values.size}]\t{' '.join(map('{:.9g}'.format, listed))}"


def _cached_array_text(file: Content) -> str:
    """Return the `array_text` of an .npy file, from the cache: half a million integers take 0.06 s to format."""
    text = cached_file(
        "osl", f"{file.digest}-text", ".txt", lambda path: path.write_text(array_text(np.load(file.path)), "ascii")
    )
    return text.path.read_text(encoding="ascii")


def insert_arrays(oso: str, arrays: Mapping[str, str]) -> str:
    """Return the text of a compiled shader with other default values of its array parameters.

    `arrays` has the `array_text` of the values, by the name of the parameter. In the source text of the shader, the
    values would compile slowly. The parameters are marked as interactive, which means that their values may change
    between renders. OSL then reads the values from memory. Otherwise OSL makes an LLVM constant of each number, which
    takes 0.2 s for half a million. Raises RenderError if a parameter is missing or has another type or size.
    """
    lines = oso.split("\n")
    for name, array in arrays.items():
        kind, _, text = array.partition("\t")
        prefix = f"param\t{kind}\t{name}\t"
        number = next((number for number, line in enumerate(lines) if line.startswith(prefix)), None)
        if number is None:
            raise RenderError(f"the compiled shader has no parameter {kind} {name}")
        hints = lines[number].removeprefix(prefix).partition("\t")[2]
        lines[number] = f"{prefix}{text}\t%meta{{int,interactive,1}} {hints}"
    return "\n".join(lines)


def _link_attribute(
    tree: ShaderNodeTree, script: ShaderNodeScript, parameter: str, attribute: str, kind: str, owner: str = "GEOMETRY"
) -> None:
    """Add a socket for a shader parameter, and link it to an attribute of the mesh or, by `owner`, of the object."""
    node = add_node(tree, "Attribute", attribute_type=owner, attribute_name=attribute)
    socket = script.inputs.new(type=_ATTRIBUTE_SOCKETS[kind], name=parameter, identifier=parameter)
    tree.links.new(node.outputs["Fac" if kind == "float" else "Vector"], socket)
