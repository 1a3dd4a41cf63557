"""Make docs/images/render_spaces.png: saturated balls in saturated light, in linear Rec.709, in ACEScg, and apart.

Usage: python tests/cycles/render_spaces.py PICTURE
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from test_passes import CENTER, POSE, balls, task_of

from lookdev.light import Emission, RectLight, load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.output.display import to_display, write_pixels
from lookdev.rendering.backends import WORKER_COMMAND
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Film, Sampling, Scene
from lookdev.space import Space, to_rec709

SIZE = (160, 120)
COLORS = {"/set/ball": (0.8, 0.02, 0.02), "/set/others": (0.05, 0.6, 0.05)}
SPACES: tuple[Space, ...] = ("rec709", "acescg")


def main(picture: Path) -> None:
    """Render both, and write them side by side, with four times their difference about grey."""
    asset, camera = balls(), task_of(balls(), ()).scene.camera
    looks = {path: Look(path, (Layer("p", "disney", {"baseColor": color}),)) for path, color in COLORS.items()}
    x, y, z = CENTER
    dome = prepare_light(load_environment(builtin="white"))
    lights = (
        replace(dome, emission=Emission((0.25, 0.25, 0.25))),
        RectLight(width=2.0, height=2.0, position=(x, y, z + 3.5), emission=Emission((1.0, 2.0, 9.0))),
    )
    images = []
    folder = Path(tempfile.mkdtemp())
    with Worker(WORKER_COMMAND, folder / "worker.log", folder, 300.0) as worker:
        worker.start()
        for space in SPACES:
            scene = Scene(asset, looks, tuple(light.in_space(space) for light in lights), camera, Film(SIZE, space))
            task = frame_task(scene_task(scene, Sampling(samples=64, bounces=2)), POSE, space)
            frame = worker.render(task, lambda progress: None)
            images.append(to_rec709(0.5 * (frame.a + frame.b), space).astype(np.float32))
    pictures = [to_display(image, "lookdev") for image in images]
    difference = 128.0 + 4.0 * (pictures[1].astype(float) - pictures[0])
    write_pixels(picture, np.concatenate([*pictures, np.clip(difference, 0.0, 255.0).astype(np.uint8)], axis=1))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
