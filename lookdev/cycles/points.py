"""Evaluates BSDFs at points: generated OSL runs inside Cycles, in float32, once for each pixel of a picture.

`lookdev check` and `lookdev eval` compare or print the results. The input is a table with a row for each point. It is
written as an EXR, which the shader reads; the colour of a pixel is the result.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

from lookdev.arrays import Floats32, Ints32
from lookdev.cache import Content, atomic_path, cache_dir
from lookdev.codegen.osl.points import generate_point_shader
from lookdev.codegen.points import PointLayer, point_cells, point_columns
from lookdev.codegen.source import ShaderSource, TableBinding
from lookdev.cycles import engine, version
from lookdev.cycles.shaders import add_script_node, array_text
from lookdev.errors import RenderError

# The width of the picture in pixels. Like the number of rows and `point_cells`, it is a power of two.
_ROW_PIXELS = 128
# The least height of the picture in pixels. Blender does not render fewer rows.
_MIN_ROWS = 4


def evaluate_points(source: ShaderSource, table: Floats32, cells: int) -> tuple[Floats32, Floats32]:
    """Evaluate the shader of `lookdev.codegen.osl.points` at points, the rows (n, columns) of a table.

    `cells` is the number of texels of a row in the EXR.

    Returns
    -------
    f : (n, 3)
        The BSDF in 1/sr.
    pdf : (n,)
        The density of sampled directions in 1/sr.
    """
    # The parameter `what` of the shader selects the output: 0 is f, 1 the pdf.
    f, density = (render_table(source, table, cells, what=output) for output in (0, 1))
    return f, density[:, 0]


def render_table(
    source: ShaderSource,
    table: Floats32,
    cells: int,
    samples: int = 1,
    arrays: Mapping[str, Ints32 | Floats32] | None = None,
    **values: int,
) -> Floats32:
    """Return the emission (n, 3) of a shader that reads the rows of a table (n, columns), one row in each pixel.

    In the file of the table, a row has `cells` texels of three channels. The parameters of the shader are
    `points_file` (this file), `columns` and `rows` (the size of the picture), and `values`. `arrays` has the default
    values of array parameters, by name.
    """
    count, width = table.shape
    rows = max(_MIN_ROWS, 1 << (-(-count // _ROW_PIXELS) - 1).bit_length())
    padded = np.zeros((rows * _ROW_PIXELS, cells * 3), dtype=np.float32)
    padded[:count, :width] = table
    scene = engine.empty_scene()
    engine.configure_osl(scene, (_ROW_PIXELS, rows), bounces=0)
    # This narrow filter puts samples near the centre of the pixel. At the edge of a pixel, rounding to float32 could
    # select the row of a neighbour. A box filter would always be a pixel wide.
    scene.cycles.pixel_filter_type = "GAUSSIAN"
    scene.cycles.filter_width = 0.01
    material = bpy.data.materials.new("points")
    material.cycles.emission_sampling = "NONE"
    add_plane(scene, rows / _ROW_PIXELS).materials.append(material)
    with atomic_path(cache_dir("points") / "points.exr") as path:
        header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": padded.reshape(rows, _ROW_PIXELS * cells, 3)}).write(str(path))
        values |= {"columns": _ROW_PIXELS, "rows": rows}
        texts = {name: array_text(array) for name, array in (arrays or {}).items()}
        add_script_node(version.clear_node_tree(material), source, {"points_file": str(path), **values}, texts)
        return engine.render_passes(scene, samples)["Combined"][..., :3].reshape(-1, 3)[:count].copy()


def add_plane(scene: bpy.types.Scene, height: float) -> bpy.types.Mesh:
    """Add a plane from (-1, -height) to (1, height), and a camera above it that sees exactly the plane.

    Returns the mesh of the plane.
    """
    mesh = bpy.data.meshes.new("plane")
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    mesh.from_pydata([(x, y * height, 0.0) for x, y in corners], [], [(0, 1, 2, 3)])
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.sensor_fit, lens.ortho_scale = "ORTHO", "HORIZONTAL", 2.0
    for data in (mesh, lens):
        scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    scene.camera = bpy.data.objects["camera"]
    scene.camera.location = (0.0, 0.0, 1.0)
    return mesh


def evaluate_file(request: Path) -> None:
    """Evaluate a request that `lookdev.checks.evaluate` has written, an .npz; write f and pdf to an .npz next to it."""
    with np.load(request, allow_pickle=False) as stored:
        bindings = json.loads(str(stored["tables"]))
        tables = tuple(TableBinding(name, Content(digest, suffix)) for name, digest, suffix in bindings)
        source = ShaderSource("points", str(stored["osl"]), (), (), digest="", tables=tables)
        f, pdf = evaluate_points(source, stored["table"], int(stored["cells"]))
    with atomic_path(request.with_suffix(".result.npz")) as path:
        np.savez(path, f=f, pdf=pdf)


def run_self_test() -> dict[str, object]:
    """Compile and evaluate a diffuse lobe in Cycles; return what was tested. Raises RenderError for a wrong value."""
    layers = [PointLayer("disney", {"variant": "2014"})]
    columns = point_columns(layers)
    row = dict.fromkeys(columns, 0.0) | {"wo_z": 1.0, "wi_z": 1.0, "layer0_roughness": 1.0, "layer0_presence": 1.0}
    row |= {f"layer0_baseColor_{i}": 0.5 for i in range(3)}
    table = np.array([[row[name] for name in columns]], dtype=np.float32)
    f, _ = evaluate_points(generate_point_shader(layers, ["diffuse"]), table, point_cells(layers))
    if not np.allclose(f, 0.5 / np.pi, rtol=1e-5):
        raise RenderError(f"OSL evaluates to {f.tolist()} for a diffuse surface, {0.5 / np.pi} would be right")
    return {"blender": version.VERSION, "osl": True}
