from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lookdev.batch.lock import output_lock, remove_leftovers
from lookdev.errors import OutputError

HOLD = """
import sys
from pathlib import Path
from lookdev.batch.lock import output_lock
with output_lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_run_names_the_holder_of_the_output_and_a_killed_one_holds_nothing(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with subprocess.Popen(
        (sys.executable, "-c", HOLD, str(out)), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(OutputError, match=rf"process {holder.pid} on .*wait for its end"), output_lock(out):
            raise AssertionError("two runs hold one output")
        holder.kill()
    with output_lock(out) as folder:
        assert folder == out / ".lookdev"


def test_an_output_that_cannot_be_made_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(OutputError, match="out: the output folder cannot be written"), output_lock(tmp_path / "out"):
        raise AssertionError("a file cannot be an output folder")


def test_only_what_a_killed_run_left_is_removed(tmp_path: Path) -> None:
    state, frames = tmp_path / ".lookdev", tmp_path / "gold"
    (state / "scratch-abc" / "deeper").mkdir(parents=True)
    (state / "scratch-abc" / "frame.npz").touch()
    frames.mkdir()
    left = [
        state / ".pictures.77-0a1b2c3d.json",
        frames / ".element.0001.77-0a1b2c3d.exr",
        frames / ".element.0001.77-0a1b2c3d.png",
    ]
    kept = [
        state / "pictures.json",
        frames / "element.0001.exr",
        frames / ".element.0001.exr",
        frames / ".notes.77-0a1b2c.txt",
        frames / "element.77-0a1b2c3d.exr",
    ]
    for path in left + kept:
        path.touch()
    with output_lock(tmp_path):
        assert not (state / "scratch-abc").exists()
        remove_leftovers([state, frames, tmp_path / "not_made_yet"])
    assert not any(path.exists() for path in left)
    assert all(path.exists() for path in kept)
