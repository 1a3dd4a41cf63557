"""Jobs whose USD and MaterialX files have absolute paths, on another machine: path rules map these paths."""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from usd_text import job_toml, mtlx, textured

from lookdev.errors import LookdevError
from lookdev.job.mapping import PathRules, read_rules
from lookdev.plan.prepare import plan_job
from lookdev.run.manifest import input_files
from lookdev.run.render import load_mapped_job, mapped_files

CAR = """#usda 1.0
( defaultPrim = "Car"
  upAxis = "Y" )
def "Car" ( references = @FOLDER/parts/body.usda@ ) {}
"""
BODY = '#usda 1.0\n( defaultPrim = "Body" )\ndef Sphere "Body" {}\n'
LOOK = "#usda 1.0\n( subLayers = [@FOLDER/parts/base.usda@] )\n"
BASE = '#usda 1.0\n( defaultPrim = "Look" )\n' + textured("Look", file="FOLDER/parts/color.png", space="sRGB")
JOB = job_toml("paint = look.usda, metal = metal.mtlx", asset='{ usd = "FOLDER/car.usda" }')
FILES = {
    "car.usda": CAR,
    "parts/body.usda": BODY,
    "look.usda": LOOK,
    "parts/base.usda": BASE,
    "metal.mtlx": mtlx("FOLDER/parts/color.png", "srgb_texture"),
    "job.toml": JOB,
}


@pytest.fixture
def studio(tmp_path: Path) -> Path:
    folder = tmp_path / "studio"
    (folder / "parts").mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(text.replace("FOLDER", str(folder)))
    assert oiio.ImageBuf(np.full((4, 4, 3), 0.3, np.float32)).write(str(folder / "parts/color.png"), oiio.UINT8)
    return folder


def plan_digests(job: Path, rules: PathRules) -> tuple[list[str], set[Path]]:
    """Return the digests of frames, and all files that the job reads."""
    with mapped_files(rules):
        prepared = plan_job(load_mapped_job(job, rules))
        return [frame.task.digest for frame in prepared.plan.frames], set(input_files(prepared.job))


def rules(folder: Path, source: Path, target: Path) -> PathRules:
    rule = {"source_path_format": "POSIX", "source_path": str(source), "destination_path": str(target)}
    (folder / "rules.json").write_text(json.dumps({"version": "pathmapping-1.0", "path_mapping_rules": [rule]}))
    return read_rules(folder / "rules.json")


@pytest.mark.parametrize("target", ["farm", "studio/mounted"], ids=["elsewhere", "inside the source"])
def test_a_moved_job_finds_what_its_files_name_and_its_frames_are_the_same(
    studio: Path, tmp_path: Path, target: str
) -> None:
    digests, files = plan_digests(studio / "job.toml", ())
    assert {file.relative_to(studio).as_posix() for file in files} == {*FILES, "parts/color.png"}
    aside = studio.rename(tmp_path / "aside")
    (tmp_path / target).parent.mkdir(exist_ok=True)
    farm = aside.rename(tmp_path / target)
    moved = rules(tmp_path, studio, farm)
    for _ in range(2):  # twice in one process: layers may still be open
        assert plan_digests(farm / "job.toml", moved) == (digests, {farm / file.relative_to(studio) for file in files})
    # Without rules, the message names the missing file.
    with pytest.raises(LookdevError, match=f"{studio}/parts/base.usda"):
        plan_job(load_mapped_job(farm / "job.toml", moved))
