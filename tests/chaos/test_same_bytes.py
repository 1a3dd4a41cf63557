"""Batches that are killed, stopped and kept from writing, again and again, end with the same bytes."""

import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from storm import contents

from lookdev.processes import end_with_parent

pytest.importorskip("av")

PROGRAM, STORM = (Path(__file__).with_name(f"{name}.py") for name in ("all_outputs", "storm"))


def finish(folder: Path, kills: random.Random | None, longest: float) -> int:
    """Run the batch until it ends by itself; return how often it was killed."""
    killed = 0
    while True:
        command = [sys.executable, str(PROGRAM), str(folder)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, preexec_fn=end_with_parent)
        try:
            assert process.wait(kills.uniform(0.0, longest) if kills else 120.0) == 0
            return killed
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            killed += 1
            # So that it ends at last, whatever the machine's speed.
            longest *= 1.05


@pytest.mark.chaos
def test_a_killed_batch_ends_with_the_same_bytes(tmp_path: Path) -> None:
    """Of every kind of output; the storm, of which a part is in the default tier, is of frames, pictures and sheets."""
    rounds, started = 100, time.perf_counter()
    finish(tmp_path, None, 0.0)
    seconds = time.perf_counter() - started
    whole = contents(tmp_path / "out")
    assert {Path(name).suffix for name in whole} >= {".exr", ".png", ".mp4", ".mov", ".webm"}
    assert any(name.endswith(".metals.wedge.png") for name in whole)
    _, parts = next(each for name, each in whole.items() if name.endswith(".exr"))
    assert {"depth.Z", "diffuse.R", "indirect.B", "CryptoObject00.R"} <= {*parts[0][0]}
    rng = random.Random(rounds)
    while rounds:
        shutil.rmtree(tmp_path / "out")
        if not finish(tmp_path, rng, seconds):
            # The first run was slower, as its files were not in memory yet: a round counts only with a kill.
            seconds /= 2
            continue
        rounds -= 1
        again = contents(tmp_path / "out")
        assert list(again) == list(whole)
        assert [name for name, each in again.items() if each != whole[name]] == []


@pytest.mark.parametrize("kills", [10, pytest.param(1000, marks=pytest.mark.chaos)], ids=lambda kills: f"{kills} kills")
def test_a_storm_leaves_all_frames_and_nothing_else(kills: int) -> None:
    # A process of its own, as it forks: this one may have threads.
    command = [sys.executable, str(STORM), str(kills), "23"]
    ended = subprocess.run(command, capture_output=True, text=True, preexec_fn=end_with_parent)
    assert ended.returncode == 0, ended.stderr[-4000:]
    assert "'run killed'" in ended.stdout
