"""What a frame costs beyond its samples: run as a script, it prints a table and asserts nothing.

    python tests/bench/fixed_cost.py

Frames of an element and of a lighting turntable are rendered in a warm worker with 2, 16 and 64 samples a pixel,
interleaved. A straight line through the medians, seconds over samples, meets zero samples at the fixed cost. It is
given for the render itself (worker) and for all a user waits for (EXR and PNG written too).
"""

import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from lookdev.asset import load_asset
from lookdev.cache import cache_dir
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.output import write_frame, write_png
from lookdev.render.backends import WORKER_COMMAND
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Camera, Pose, Sampling, Scene

SAMPLES, FRAMES, RESOLUTION = (2, 16, 64), 8, (256, 256)


def main() -> None:
    """Measure and print."""
    asset = load_asset(builtin="shaderball")
    look = Look("plastic", (Layer("Plastic", "disney", {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.3}),))
    camera = Camera(40.0, 15.0, asset.center, 3.5 * asset.radius)
    sampling = Sampling(2, None, 2, 4, 2, 0)
    light = prepare_light(load_environment(builtin="studio"))
    scene = scene_task(Scene.of_look(asset, look, light, RESOLUTION, camera), sampling)
    worker_seconds: dict[tuple[str, int], list[float]] = {}
    user_seconds: dict[tuple[str, int], list[float]] = {}
    with (
        tempfile.TemporaryDirectory(dir=cache_dir("bench")) as folder,
        Worker(WORKER_COMMAND, Path(folder) / "worker.log", Path(folder)) as worker,
    ):
        worker.start()
        for number in range(FRAMES + 1):
            for kind in ("element", "lighting"):
                angle = 360.0 * number / FRAMES
                pose = Pose(angle, 0.0) if kind == "element" else Pose(0.0, angle)
                for samples in SAMPLES:
                    file = Path(folder) / f"{kind}.exr"
                    task = one_frame(scene, pose, f"{kind}{number}{samples}", samples=samples)
                    started = time.perf_counter()
                    frame = worker.render(task, lambda progress: None)
                    beauty = (frame.a + frame.b) / 2
                    write_frame(file, beauty, frame.alpha, {"digest": task.digest})
                    write_png(file.with_suffix(".png"), beauty, frame.alpha, "ACES 1.0 - SDR Video")
                    if number:  # the first frame of each kind warms up
                        user_seconds.setdefault((kind, samples), []).append(time.perf_counter() - started)
                        worker_seconds.setdefault((kind, samples), []).append(frame.seconds)
    for what, seconds in (("worker", worker_seconds), ("user", user_seconds)):
        for kind in ("element", "lighting"):
            medians = [statistics.median(seconds[kind, samples]) for samples in SAMPLES]
            slope, intercept = np.polyfit(SAMPLES, medians, 1)
            row = "  ".join(f"{n:3d} spp {value:6.3f} s" for n, value in zip(SAMPLES, medians, strict=True))
            print(f"{what:6s} {kind:8s} {row}  fixed {intercept:6.3f} s  {1e3 * slope:6.1f} ms/sample")  # noqa: T201


if __name__ == "__main__":
    main()
