"""Batches that are killed, stopped and kept from writing, again and again, end with the same bytes."""

import random
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import OpenImageIO as oiio
import pytest

from lookdev.lifetime import end_with_parent
from lookdev.output.exr import read_frame, read_header

pytest.importorskip("av")

PROGRAM, STORM = (Path(__file__).with_name(f"{name}.py") for name in ("all_outputs", "storm"))
# What depends on when and by which process a frame was rendered.
OF_THE_RUN = {"time", "seconds", "host", "memory"}


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


def files(folder: Path) -> dict[str, Any]:
    """Return all files by their names: bytes, of frames all channels and the header but what is of the run."""
    found: dict[str, Any] = {}
    for path in sorted((folder / "out").rglob("*")):
        name = path.relative_to(folder / "out").as_posix()
        if path.is_dir() or name.startswith(".lookdev/") or name in ("manifest.json", "pictures.json"):
            continue
        if path.suffix == ".exr":
            header = {key: each for key, each in (read_header(path) or {}).items() if key not in OF_THE_RUN}
            read_frame(path)  # whole
            buffer = oiio.ImageBuf(str(path))
            found[name] = (header, list(buffer.spec().channelnames), buffer.get_pixels(oiio.FLOAT).tobytes())
        else:
            found[name] = path.read_bytes()
    return found


@pytest.mark.parametrize(
    "rounds", [1, pytest.param(100, marks=pytest.mark.chaos)], ids=lambda rounds: f"{rounds} times"
)
def test_a_killed_batch_ends_with_the_same_bytes(rounds: int, tmp_path: Path) -> None:
    started = time.perf_counter()
    finish(tmp_path, None, 0.0)
    seconds = time.perf_counter() - started
    whole = files(tmp_path)
    assert {Path(name).suffix for name in whole} >= {".exr", ".png", ".mp4", ".mov", ".webm"}
    assert any(name.endswith(".metals.wedge.png") for name in whole)
    frame = next(each for name, each in whole.items() if name.endswith(".exr"))
    assert {"depth.Z", "diffuse.R", "indirect.B", "CryptoObject00.R"} <= {*frame[1]}
    rng = random.Random(rounds)
    while rounds:
        shutil.rmtree(tmp_path / "out")
        if not finish(tmp_path, rng, seconds):
            # The first run was slower, as its files were not in memory yet: a round counts only with a kill.
            seconds /= 2
            continue
        rounds -= 1
        again = files(tmp_path)
        assert list(again) == list(whole)
        assert [name for name, each in again.items() if each != whole[name]] == []


@pytest.mark.parametrize("kills", [10, pytest.param(1000, marks=pytest.mark.chaos)], ids=lambda kills: f"{kills} kills")
def test_a_storm_leaves_all_frames_and_nothing_else(kills: int) -> None:
    # A process of its own, as it forks: this one may have threads.
    command = [sys.executable, str(STORM), str(kills), "23"]
    ended = subprocess.run(command, capture_output=True, text=True, preexec_fn=end_with_parent)
    assert ended.returncode == 0, ended.stderr[-4000:]
    assert "'run killed'" in ended.stdout
