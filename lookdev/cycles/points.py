"""A stack of layers at listed points: the generated OSL, evaluated inside Cycles, its float32 values read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from lookdev.cache import atomic_path, cache_dir
from lookdev.codegen import ShaderSource
from lookdev.codegen.osl.points import PointLayer, generate_points, point_cells, point_columns
from lookdev.cycles import engine, version
from lookdev.cycles.shaders import script_node
from lookdev.errors import RenderError

# A power of two, as the rows and `point_cells` are.
_COLUMNS = 128
# Blender renders no fewer rows than this, whatever it is told.
_MIN_ROWS = 4


def evaluate_points(
    source: ShaderSource, table: NDArray[np.float32], cells: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Evaluate a stack of layers in Cycles.

    Parameters
    ----------
    source
        What `lookdev.codegen.osl.points.generate_points` makes of the layers.
    table : (n, columns)
        A row a point, columns as `point_columns` says.
    cells
        The texels of a row, as `point_cells` says.

    Returns
    -------
    f : (n, 3) in 1/sr
    pdf : (n,) in 1/sr
    """
    count, used = table.shape
    rows = max(_MIN_ROWS, 1 << (-(-count // _COLUMNS) - 1).bit_length())
    padded = np.zeros((rows * _COLUMNS, cells * 3), dtype=np.float32)
    padded[:count, :used] = table
    image = padded.reshape(rows, _COLUMNS * cells, 3)
    with atomic_path(cache_dir("points") / "points.exr") as path:
        header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": image}).write(str(path))
        f = _render(source, path, rows, what=0)[:count]
        pdf = _render(source, path, rows, what=1)[:count, 0]
    return f, pdf


def _render(source: ShaderSource, table: Path, rows: int, what: int) -> NDArray[np.float32]:
    """Render a plane that fills the picture: one point a pixel."""
    scene = engine.empty_scene()
    engine.configure(scene, (_COLUMNS, rows), bounces=0)
    # Near its pixel's centre: a sample within float32's rounding of the edge would read its neighbour's row. A box
    # filter is always a pixel wide.
    scene.cycles.pixel_filter_type = "GAUSSIAN"
    scene.cycles.filter_width = 0.01
    width, height = 1.0, rows / _COLUMNS
    mesh = bpy.data.meshes.new("points")
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    mesh.from_pydata([(x * width, y * height, 0.0) for x, y in corners], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="st")
    material = bpy.data.materials.new("points")
    material.cycles.emission_sampling = "NONE"
    values: dict[str, str | int | float] = {"points_file": str(table), "columns": _COLUMNS, "rows": rows, "what": what}
    script_node(version.empty_node_tree(material), source, values)
    mesh.materials.append(material)
    _add(scene, "points", mesh)
    lens = bpy.data.cameras.new("camera")
    lens.type = "ORTHO"
    lens.sensor_fit = "HORIZONTAL"
    lens.ortho_scale = 2.0 * width
    scene.camera = _add(scene, "camera", lens)
    scene.camera.location = (0.0, 0.0, 1.0)
    return engine.render_passes(scene, 1)["Combined"][..., :3].reshape(-1, 3)


def _add(scene: Any, name: str, data: Any) -> Any:
    item = bpy.data.objects.new(name, data)
    scene.collection.objects.link(item)
    return item


def evaluate_file(request: Path) -> None:
    """Answer a request of `lookdev.checks.evaluate`: an .npz in, its f and pdf beside it."""
    with np.load(request, allow_pickle=False) as stored:
        source = ShaderSource("points", str(stored["osl"]), (), (), digest="")
        f, pdf = evaluate_points(source, stored["table"], int(stored["cells"]))
    with atomic_path(request.with_suffix(".result.npz")) as path:
        np.savez(path, f=f, pdf=pdf)


def self_test() -> dict[str, object]:
    """Evaluate one Lambertian-like point in Cycles to show that OSL compiles, runs and is read back right.

    Raises
    ------
    RenderError
        The value is wrong.
    """
    layers = [PointLayer("disney", {"variant": "2014"})]
    columns = point_columns(layers)
    row = dict.fromkeys(columns, 0.0) | {"wo_z": 1.0, "wi_z": 1.0, "layer0_roughness": 1.0}
    row |= {f"layer0_baseColor_{i}": 0.5 for i in range(3)}
    table = np.array([[row[name] for name in columns]], dtype=np.float32)
    f, _ = evaluate_points(generate_points(layers, ["diffuse"]), table, point_cells(layers))
    if not np.allclose(f, 0.5 / np.pi, rtol=1e-5):
        raise RenderError(f"OSL answers {f.tolist()} for a diffuse surface, {0.5 / np.pi} would be right")
    return {"blender": version.VERSION, "osl": True}
