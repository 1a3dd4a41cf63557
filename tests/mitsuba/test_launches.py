"""How long a launch takes decides how much the next one renders, and nothing of the picture."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from frames import POSE
from looks import LOOKS

from lookdev.asset import load_asset
from lookdev.material import Look
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.wire import encode
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.mitsuba


def test_a_frame_does_not_depend_on_the_speed_of_launches(llvm: str, light_of, tmp_path: Path) -> None:
    look = Look("coated", LOOKS["coated"])
    scene = Scene.of_look(load_asset(builtin="suzanne"), look, light_of("city"), (24, 18))
    task = one_frame(scene_task(scene, Sampling(samples=512, error=4e-3), "mitsuba"), POSE, "frame")
    (tmp_path / "task.json").write_text(encode(task))
    found = []
    # As on a machine that is forty times slower.
    for seconds in ("0.2", "0.005"):
        probe = Path(__file__).with_name("launch_probe.py")
        file = tmp_path / f"{seconds}.npz"
        subprocess.run([sys.executable, str(probe), str(tmp_path / "task.json"), seconds, str(file)], check=True)
        with np.load(file) as arrays:
            found.append({name: arrays[name] for name in arrays.files})
    fast, slow = found
    assert fast["alpha"].max() == 1.0
    for name, array in fast.items():
        assert np.array_equal(array, slow[name]), name
