"""The looks and frames that `check_file` passes to the checks."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from usd_text import job_toml

from lookdev.asset import load_asset
from lookdev.brdf import CONTINUOUS_MODELS
from lookdev.checks import check
from lookdev.checks.check import check_file
from lookdev.checks.finding import CheckFinding
from lookdev.codegen.source import NodeSource, ShaderSource
from lookdev.errors import FaultsError, LookdevError
from lookdev.light import load_environment
from lookdev.material import Look
from lookdev.rendering.task import FrameTask

MATERIALS = Path(__file__).parents[2] / "materials"
METAL = MATERIALS / "brushed_metal.usda"
JOB = job_toml(
    f"leaf = {MATERIALS}/classic/lambert.usda, gold = {MATERIALS}/brushed_metal.usda",
    ibl='[{ name = "white", builtin = "white" }, { name = "studio", builtin = "white", rotation = 90.0 }]',
    turntable='[{ kind = "element", frames = 5 }]',
    render="{ resolution = [400, 200], samples = 64, seed = 3 }",
)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    return path


@pytest.fixture
def dark() -> set[float]:
    """Return the angles of the asset at which pictures are black."""
    return set()


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch, dark: set[float]) -> list[FrameTask]:
    """Replace renderer and checks by fakes that agree, and assets and lights by quick ones; return rendered tasks."""
    tasks: list[FrameTask] = []

    def render(task: FrameTask) -> SimpleNamespace:
        tasks.append(task)
        width, height = task.scene.resolution
        image = np.full((height, width, 3), task.pose.element not in dark, np.float32)
        return SimpleNamespace(a=image, b=image, alpha=image[..., 0])

    def agree(name: str) -> Callable[..., CheckFinding]:
        return lambda look, *rest, **options: CheckFinding(
            name, look.name if isinstance(look, Look) else look, True, ""
        )

    quick = {("asset", "shaderball"): load_asset(builtin="plane"), ("light", "city"): load_environment(builtin="white")}
    monkeypatch.setattr(check, "load_asset", lambda builtin: quick["asset", builtin])
    monkeypatch.setattr(check, "load_environment", lambda builtin: quick["light", builtin])
    monkeypatch.setattr(check, "MeshScene", lambda *rest: None)
    monkeypatch.setattr(check, "open_renderer", lambda: nullcontext(render))
    for function, name in (("check_points", "points"), ("check_albedo", "albedo"), ("check_frame", "image")):
        monkeypatch.setattr(check, function, agree(name))
    monkeypatch.setattr(check, "frame_pixels", lambda *rest, **options: None)
    return tasks


def run_checks(file: Path | None, **options: Any) -> list[tuple[str, str]]:
    return [(finding.check, finding.subject) for finding in check_file(file, **options)]


@pytest.mark.usefixtures("rendered")
def test_a_job_has_each_look_checked_and_a_frame_of_each_look_and_light(job: Path) -> None:
    assert run_checks(job) == [
        *((name, look) for name in ("points", "albedo") for look in ("leaf", "gold")),
        *(("image", f"{look}, {ibl}") for look in ("leaf", "gold") for ibl in ("white", "studio")),
    ]
    assert run_checks(job, only=["albedo"]) == [("albedo", "leaf"), ("albedo", "gold")]


def test_frames_are_the_jobs_own_but_small_altered_and_of_other_seeds(job: Path, rendered: list[FrameTask]) -> None:
    run_checks(job, only=["image"], seed=5, alter=lambda osl: osl.replace("direct +=", "direct -="))
    assert len(rendered) == 4 * 4
    for task in rendered:
        assert task.scene.resolution == (128, 64)
        assert task.scene.sampling.error is None
        assert task.pose.element % 72.0 == 0.0
        assert all("direct -=" in shader.osl for shader in task.scene.shaders)
    first = rendered[:4]
    assert len({task.scene.sampling.seed for task in first}) == 4
    assert len({task.digest for task in rendered}) == len(rendered)
    assert len({(task.scene.asset, task.pose, task.scene.camera) for task in first}) == 1


def test_a_pose_without_light_is_passed_over(job: Path, rendered: list[FrameTask], dark: set[float]) -> None:
    dark |= {0.0, 72.0, 144.0, 216.0}
    assert all(not finding.skipped for finding in check_file(job, only=["image"]))
    assert {task.pose.element for task in rendered} > {288.0}
    dark.add(288.0)
    skipped = [finding.skipped for finding in check_file(job, only=["image"])]
    assert all("no light arrives" in reason for reason in skipped)
    assert len(skipped) == 4


def test_stability_is_of_the_models_or_of_the_looks(
    job: Path, rendered: list[FrameTask], monkeypatch: pytest.MonkeyPatch
) -> None:
    def check_stability(subjects: list[str | Look], render: object, **options: object) -> Iterator[CheckFinding]:
        for subject in subjects:
            yield CheckFinding("stability", subject.name if isinstance(subject, Look) else subject, True, "")

    monkeypatch.setattr(check, "check_stability", check_stability)
    assert run_checks(None, only=["stability"]) == [("stability", model) for model in CONTINUOUS_MODELS]
    assert run_checks(job, only=["stability"]) == [("stability", "leaf"), ("stability", "gold")]


@pytest.mark.usefixtures("rendered")
def test_a_look_alone_takes_its_variants_and_prim() -> None:
    checked = run_checks(METAL, only=["points", "image"], variants={"metal": "copper"})
    assert checked == [("points", "brushed_metal"), ("image", "brushed_metal, city")]
    metals = run_checks(METAL, only=["image"], variants={"metal": "*"})
    assert ("image", "brushed_metal_copper, city") in metals
    assert len(set(metals)) == len(metals) > 1
    for options, name in (({"variants": {"metal": "mithril"}}, "mithril"), ({"prim": "/Nowhere"}, "/Nowhere")):
        with pytest.raises(FaultsError, match=name):
            run_checks(METAL, **options)


def test_native_nodes_are_compared_with_the_exact_picture(rendered: list[FrameTask]) -> None:
    points, albedo, image = check_file(METAL, backend="nodes", depth="quick")
    assert "backend nodes" in points.skipped
    assert albedo.check == "albedo"
    # All pictures of the fake are white: no difference.
    assert (image.passed, image.figures["flip"]) == (True, 0.0)
    assert [type(task.scene.shaders[0]) for task in rendered] == [NodeSource] * 4 + [ShaderSource] * 4
    assert len({task.scene.sampling.seed for task in rendered}) == 8
    assert len({(task.scene.resolution, task.scene.sampling.samples, task.pose) for task in rendered}) == 1


def test_exact_nodes_are_compared_with_the_reference(rendered: list[FrameTask]) -> None:
    points, *others = check_file(METAL, backend="nodes-exact", depth="quick")
    assert points.skipped
    assert [finding.check for finding in others] == ["albedo", "image"]
    assert {type(task.scene.shaders[0]) for task in rendered} == {NodeSource}


def test_a_job_has_its_own_backend_and_none_but_those_of_jobs_is_known(job: Path, rendered: list[FrameTask]) -> None:
    with pytest.raises(LookdevError, match="the backend of a job is"):
        list(check_file(job, backend="nodes"))
    with pytest.raises(LookdevError, match=r"no backend 'node' \(did you mean 'nodes'\?\)"):
        list(check_file(METAL, backend="node"))
    job.write_text(JOB.replace("seed = 3", 'seed = 3, backend = "nodes"'))
    assert all("flip" in finding.figures for finding in check_file(job, only=["image"], depth="quick"))
    assert {type(task.scene.shaders[0]) for task in rendered} == {NodeSource, ShaderSource}
