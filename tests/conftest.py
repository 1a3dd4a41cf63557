"""A small scene and a job of it, without geometry, shaders or light on disk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import pytest

from lookdev.asset import load_asset
from lookdev.cache import Content, take_notes
from lookdev.codegen import (
    AttributeBinding,
    GroupSocket,
    Link,
    NodeSource,
    NodeTree,
    ShaderNode,
    ShaderSource,
    TextureBinding,
)
from lookdev.job import Job, parse_job
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.plan import Setup
from lookdev.render.task import SceneTask
from lookdev.scene import Camera, Sampling, Scene

JOB = """
output = "out"
asset = { builtin = "sphere" }
look = [{ name = "gold", material = "gold.usda" }, { name = "paint", material = "gold.usda" }]
ibl = [{ name = "city", builtin = "city", exposure = 0.5 }, { name = "studio", builtin = "studio" }]
[[turntable]]
kind = "element"
frames = 4
[[turntable]]
kind = "lighting"
frames = 3
"""


@pytest.fixture(autouse=True)
def _no_config_of_a_studio(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are in the views of the config that ships, whatever ``$OCIO`` is."""
    monkeypatch.delenv("OCIO", raising=False)


@pytest.fixture(autouse=True)
def _no_notes() -> None:
    """Forget what the test before left of damaged files."""
    take_notes()


@pytest.fixture
def scene() -> SceneTask:
    osl = 'shader gold() {\n\t"quoted \u03b1"\r\n}\n'
    texture, attribute = TextureBinding("base_file", Content("7e87", ".exr")), AttributeBinding("st", "st", "uv")
    return SceneTask(
        asset=Content("a55e7", ".npz"),
        backend="exact",
        shaders=(ShaderSource("gold", osl, (texture,), (attribute,), "500d"),),
        worn=(0,),
        lights=(Dome(*(Content(part, ".exr") for part in "rpsb"), 1024, 512, "119147"),),
        resolution=(64, 48),
        sampling=Sampling(brdf_samples=2, ibl_samples=4),
        camera=Camera(fov=39.6, elevation=10.0, target=(0.1, 0.2, 1 / 3), distance=3.7),
    )


Tasks = Mapping[tuple[str, str], SceneTask]


@pytest.fixture
def make_setups(scene: SceneTask) -> Callable[..., list[Setup]]:
    """Return a function that makes the setups of a job from tasks by look and light; all have the same look."""
    asset = load_asset(builtin="plane")

    def make(job: Job, tasks: Tasks, around: Collection[tuple[str, str]] = (), look: Look | None = None) -> list[Setup]:
        shown = Scene.of_look(asset, look or Look("gold", (Layer("Base", "disney"),)), scene.lights[0], (64, 48))
        sampling = job.render.sampling
        return [
            Setup(*key, shown, tasks[key], sampling, key in around, ibl.exposure, ibl.rotation)
            for each in job.look
            for ibl in job.ibl
            if (key := (each.name, ibl.name))
        ]

    return make


@pytest.fixture
def node_source() -> NodeSource:
    """Return native nodes with every kind of value."""
    group = NodeTree(
        "Lookdev Disney",
        (
            ShaderNode("In", "NodeGroupInput"),
            ShaderNode("Map", "TexImage", {"extension": "CLIP"}, {}, "t \u00e9", image=Content("7e87", ".exr")),
            ShaderNode(
                "Mix",
                "Mix",
                {"clamp_factor": False, "clamp_result": True, "data_type": "RGBA"},
                {"Factor_Float": 0.1, "A_Color": (0.2, 1 / 3, 0.4), "B_Color": Link("In", "baseColor")},
                place=(-200.0, 1.5),
            ),
        ),
        (GroupSocket("baseColor", "color", (0.8, 0.7, 0.6), (0.0, 1.0), "The colour.", "Base"),),
        (GroupSocket("BSDF", "shader"),),
    )
    material = NodeTree("gold", (ShaderNode("Disney", "Group", group="Lookdev Disney"),))
    attributes = (AttributeBinding("wear", "wear", "float", (0.5,)),)
    return NodeSource("gold", (group, material), attributes, "40de5", exact=False, transmits=True)


@pytest.fixture
def make_job(tmp_path: Path) -> Callable[..., Job]:
    """Return a function that reads the job, with text appended."""

    def make(more: str = "") -> Job:
        (tmp_path / "gold.usda").touch()
        return parse_job(JOB + more, tmp_path / "job.toml")

    return make
