"""Run OSL snippets inside Blender's Cycles, a row of numbers a pixel: ``python osl_probe.py request.npz answer.npz``.

The request holds for every probe its shader text (``NAME.osl``), its table (``NAME.table``, (n, 12) float32) and the
samples a pixel (``NAME.samples``), and arrays that are parameters of all of them (``array.NAME``); the answer holds
what the shader emitted, (n, 3), averaged over the samples.
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from lookdev.codegen import ShaderSource

COLUMNS = 128
CELLS = 4  # texels of three numbers that a row of the table takes

TEMPLATE = """
#define SAMPLES %(samples)d
#include "stdosl.h"
%(headers)s
shader probe(string table_file = "", int rows = 1, %(arrays)s output closure color surface = 0)
{
    vector ndc = transform("NDC", P);
    int column = int(floor(ndc[0] * 128));
    int row = int(floor(ndc[1] * rows));
    int number = column + 128 * row;
    float in[12];
    for (int i = 0; i < 4; ++i) {
        color cell = lookdev_texel(table_file, i + 4 * column, row, 4 * 128, rows);
        in[3 * i] = cell[0];
        in[3 * i + 1] = cell[1];
        in[3 * i + 2] = cell[2];
    }
    color value = 0;
    %(code)s
    surface = value * emission();
}
"""


def render(
    osl: str, table: NDArray[np.float32], samples: int, arrays: dict[str, Any], folder: Path
) -> NDArray[np.float32]:
    """Evaluate one shader over a table."""
    import bpy

    from lookdev.cycles import engine, version
    from lookdev.cycles.shaders import script_node

    rows = max(4, 1 << (-(-len(table) // COLUMNS) - 1).bit_length())
    image = np.zeros((rows * COLUMNS, CELLS * 3), dtype=np.float32)
    image[: len(table), : table.shape[1]] = table
    file = folder / "table.exr"
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": image.reshape(rows, COLUMNS * CELLS, 3)}).write(str(file))

    scene = engine.empty_scene()
    engine.configure(scene, (COLUMNS, rows), bounces=0)
    height = rows / COLUMNS
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([(x, y * height, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("probe")
    material.cycles.emission_sampling = "NONE"
    source = ShaderSource("probe", osl, (), (), "")
    script_node(version.empty_node_tree(material), source, {"table_file": str(file), "rows": rows}, arrays)
    mesh.materials.append(material)
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.sensor_fit, lens.ortho_scale = "ORTHO", "HORIZONTAL", 2.0

    def add(data: Any) -> Any:
        item = bpy.data.objects.new(data.name, data)
        scene.collection.objects.link(item)
        return item

    add(mesh)
    scene.camera = add(lens)
    scene.camera.location = (0.0, 0.0, 1.0)
    return engine.render_passes(scene, samples)["Combined"][..., :3].reshape(-1, 3)[: len(table)].copy()


def main(request: Path, answer: Path) -> None:
    """Answer all probes of a request."""
    results = {}
    with np.load(request, allow_pickle=False) as stored:
        names = {tuple(key.split(".")) for key in stored.files}
        arrays = {name: stored[f"array.{name}"] for kind, name in names if kind == "array"}
        for name in sorted({name for name, _ in names} - {"array"}):
            folder = request.parent / name
            folder.mkdir()
            osl, samples = str(stored[f"{name}.osl"]), int(stored[f"{name}.samples"])
            results[name] = render(osl, stored[f"{name}.table"], samples, arrays, folder)
    np.savez(answer, **results)


if __name__ == "__main__":
    code = 1
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
        code = 0
    except Exception:  # noqa: BLE001  (Blender's own exit can hang)
        traceback.print_exc()
    sys.stdout.flush()
    os._exit(code)
