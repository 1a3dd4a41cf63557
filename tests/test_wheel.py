"""The wheel contains all that the program needs, and works without the checkout."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]
FOLDERS = {"lookdev": "lookdev"} | {name: f"lookdev/data/{name}" for name in ("materials", "jobs", "rigs")}


def test_every_tracked_file_is_in_the_wheel():
    command = ("git", "-C", str(ROOT), "ls-files", "-z", *FOLDERS)
    tracked = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")[:-1]
    assert len(tracked) > 200
    installed = {file.replace(folder, FOLDERS[folder], 1) for file in tracked for folder in [file.partition("/")[0]]}
    assert installed - {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()} == set()


@pytest.mark.proof
@pytest.mark.cycles
def test_the_wheel_works_in_an_empty_folder(tmp_path):
    wheel = next(WheelBuilder(str(ROOT)).build(directory=str(tmp_path / "dist"), versions=["standard"]))
    site, here = tmp_path / "site", tmp_path / "here"
    zipfile.ZipFile(wheel).extractall(site)
    for path in [*site.rglob("*"), site]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    here.mkdir()
    environment = os.environ | {"PYTHONPATH": str(site), "LOOKDEV_CACHE": str(tmp_path / "cache")}

    def lookdev(*arguments):
        command = (sys.executable, "-m", "lookdev", *arguments)
        done = subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "walnut" in lookdev("materials")
    lookdev("materials", "new", "look.usda", "gold")
    assert "nothing wrong" in lookdev("validate", "look.usda")
    assert lookdev("example", "first").endswith("next: lookdev render jobs/first.toml\n")
    job = here / "jobs" / "first.toml"
    text = job.read_text().replace("[240, 160]", "[24, 16]").replace("samples = 16", "samples = 2")
    job.write_text(text.replace("frames = 6", "frames = 1"))
    assert "2 of 2 frames are done, 2 of them rendered now." in lookdev("render", str(job))
