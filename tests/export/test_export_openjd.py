"""Jobs as templates of Open Job Description; `tests/end_to_end` runs one."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from usd_text import job_toml, material

from lookdev.errors import LookdevError
from lookdev.export.openjd import HostRequirements, export_openjd
from lookdev.plan.chunks import Division

JOB = job_toml("gold = gold.usda", turntable='[{ kind = "element", frames = 5 }]', render="{ seed = 0 }")


@pytest.fixture
def job(tmp_path: Path) -> Path:
    (tmp_path / "gold.usda").write_text("#usda 1.0\n" + material("Look"))
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path / "job.toml"


def read(file: Path) -> Any:
    return (json.loads if file.suffix == ".json" else yaml.safe_load)(file.read_text())


@pytest.mark.both_pythons
def test_a_template_beside_the_job_runs_as_it_is(job: Path) -> None:
    file = job.with_name("farm.yaml")
    exported = export_openjd(job, file, Division(3))
    template = read(file)
    defaults = {parameter["name"]: parameter.get("default") for parameter in template["parameterDefinitions"]}
    assert defaults == {"Job": "job.toml", "Output": "out", "Chunks": 3, "Machines": 3, "Command": "lookdev"}
    assert exported.text.endswith(f"openjd run {file} --step Outputs --run-dependencies")
    tool = Path(sys.executable).with_name("openjd")
    checked = subprocess.run([tool, "check", file], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout
    render, outputs = template["steps"]
    assert outputs["dependencies"] == [{"dependsOn": "Render"}]
    assert "--outputs-only" in outputs["script"]["actions"]["onRun"]["args"]
    assert {"name": "amount.worker.memory", "min": 4096} in render["hostRequirements"]["amounts"]
    export_openjd(job, job.with_name("farm.json"), Division(3))
    assert read(job.with_name("farm.json")) == template


def test_a_template_elsewhere_has_paths_that_are_given(job: Path, tmp_path: Path) -> None:
    exported = export_openjd(job, tmp_path / "farm" / "t.yaml", Division(1), HostRequirements(8, 1000, "/opt/lookdev"))
    assert f"-p Job={job} -p Output={tmp_path / 'out'}" in exported.text
    template = read(tmp_path / "farm" / "t.yaml")
    assert all("default" not in parameter for parameter in template["parameterDefinitions"][:2])
    assert {"name": "amount.worker.vcpu", "min": 8} in template["steps"][0]["hostRequirements"]["amounts"]


def test_a_folder_is_a_bundle_with_values_and_all_inputs(job: Path, tmp_path: Path) -> None:
    assert export_openjd(job, tmp_path / "bundle").text.endswith(f"deadline bundle submit {tmp_path / 'bundle'}")
    assert read(tmp_path / "bundle" / "parameter_values.yaml") == {
        "parameterValues": [{"name": "Job", "value": str(job)}, {"name": "Output", "value": str(tmp_path / "out")}]
    }
    references = read(tmp_path / "bundle" / "asset_references.yaml")["assetReferences"]
    assert references["inputs"]["filenames"] == [str(tmp_path / "gold.usda")]
    assert references["outputs"]["directories"] == [str(tmp_path / "out")]


def test_a_host_of_a_job_on_a_gpu_has_one(job: Path) -> None:
    job.write_text(JOB.replace("seed = 0", 'backend = "nodes", device = "cuda"'))
    export_openjd(job, job.with_name("t.yaml"), Division(1))
    (render, _) = read(job.with_name("t.yaml"))["steps"]
    assert {"name": "amount.worker.gpu", "min": 1} in render["hostRequirements"]["amounts"]


def test_more_chunks_than_frames_and_a_missing_package_are_errors(job: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LookdevError, match=r"--chunks: a job of 5 frames has at most as many chunks, not 6"):
        export_openjd(job, job.with_name("t.yaml"), Division(6))
    monkeypatch.setitem(sys.modules, "openjd.model", None)
    with pytest.raises(LookdevError, match=r"pip install 'lookdev\[farm\]'"):
        export_openjd(job, job.with_name("t.yaml"), Division(1))
    assert not job.with_name("t.yaml").exists()
