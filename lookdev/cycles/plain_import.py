"""A plain Blender script that imports a USD file and renders one sample, the baseline of ``lookdev bench --scale``.

Run as ``python -m lookdev.cycles.plain_import REQUEST.json``. Blender's own importer creates geometry and materials;
the light is an environment texture. Standard output has the lines of JSON that `lookdev.bench.scale_job` prints.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TypedDict

import bpy

from lookdev.cycles.plain_sequence import add_environment_texture
from lookdev.processes import exit_after_block
from lookdev.rendering.answers import AnswerStream, peak_memory


class ImportRequest(TypedDict):
    """A file to import, its camera's distance, and the light: a name of Blender's worlds."""

    file: str
    light: str
    resolution: tuple[int, int]
    bounces: int
    distance: float


def render(request: ImportRequest, answers: AnswerStream) -> None:
    """Import a file and render it with one sample."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=request["file"])
    answers.send(reached="planned")
    scene = bpy.data.scenes[0]
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = request["resolution"]
    scene.render.film_transparent = True
    settings = scene.cycles
    settings.samples = 1
    settings.use_adaptive_sampling = settings.use_denoising = False
    settings.max_bounces = request["bounces"]
    texture, _ = add_environment_texture(scene)
    lights = Path(bpy.utils.resource_path("LOCAL"), "datafiles", "studiolights", "world")
    texture.image = bpy.data.images.load(str(lights / f"{request['light']}.exr"))
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.camera.location = (0.0, -request["distance"], request["distance"])
    scene.camera.rotation_euler = (math.pi / 4.0, 0.0, 0.0)
    scene.collection.objects.link(scene.camera)
    bpy.ops.render.render()
    answers.send(reached="sample", memory=[peak_memory()])


if __name__ == "__main__":
    channel = AnswerStream()
    with exit_after_block():
        render(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), channel)
