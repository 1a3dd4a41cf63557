"""A plain Blender script that imports a USD file and renders one sample: the baseline of ``lookdev bench --scale``.

The bench runs it as ``python -m lookdev.cycles.plain_import REQUEST.json``. Blender's own importer creates geometry and
materials, and the light is an environment texture. When the file is imported, and when the sample is rendered, the
script prints a line of JSON, as `lookdev.bench.scale_job` does.
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
    """The content of the request's file."""

    file: str  # the USD file
    light: str  # the name of one of the environment maps that come with Blender
    resolution: tuple[int, int]  # width and height in pixels
    bounces: int
    distance: float  # the distance of the camera from the origin, along y and along z


def render(request: ImportRequest, answers: AnswerStream) -> None:
    """Import a file and render it with one sample; report the end of both steps, and the peak memory."""
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
