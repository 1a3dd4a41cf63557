"""Rectangles of a frame beside the whole: run in a process of its own, ``python region_probe.py TASK.pickle OUT.npz``.

For each of the request's boxes the result has its passes, and those of the whole frame cut to it.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookdev.cycles import engine
from lookdev.cycles.scene import Scene
from lookdev.lifetime import leaving


def main(request: str, out: str) -> None:
    task, boxes, samples = pickle.loads(Path(request).read_bytes())
    scene = Scene(task.scene)
    scene.pose(task.scene.camera, task.pose)
    engine.fill_tables(scene.scene)
    found = {}

    def picture(number: int, samples: int, within: engine.Box | None) -> NDArray[np.float32]:
        scene.control(task.pose, number, samples)
        return engine.render_passes(scene.scene, samples, number, within)["Combined"].copy()

    for number, box in enumerate(boxes):
        left, bottom, right, top = box
        found[f"before{number}"] = picture(number, samples, None)[bottom:top, left:right]
        # Between them, all that may differ from call to call does.
        picture(number + 7, 2 * samples, boxes[number - 1])
        found[f"part{number}"] = picture(number, samples, box)
        picture(number + 9, samples, box)
        found[f"again{number}"] = picture(number, samples, box)
        found[f"after{number}"] = picture(number, samples, None)[bottom:top, left:right]
    np.savez(out, **found)


if __name__ == "__main__":
    with leaving():
        main(*sys.argv[1:])
