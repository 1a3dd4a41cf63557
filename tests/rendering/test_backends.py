"""The registry of backends: entries are complete, their tasks can be encoded, and a backend needs only its entry."""

import importlib
import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from usd_text import job_toml

from lookdev.asset import load_asset
from lookdev.cache import Content
from lookdev.codegen.principled import generate_principled
from lookdev.codegen.source import TextureBinding
from lookdev.errors import CodegenError
from lookdev.job import parse_job
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look, Primvar
from lookdev.rendering.backends import BACKENDS, Backend
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, files_of_task, frame_task
from lookdev.rendering.wire import decode_frame_task, encode_task
from lookdev.rendering.worker import open_renderer
from lookdev.scene import Pose, Sampling, Scene

PAINT = {"baseColor": (0.46, 0.02, 0.02), "roughness": 0.4, "clearcoat": 1.0, "clearcoatGloss": 0.9}
LOOK = Look("paint", (Layer("Paint", "disney", PAINT),))
LEAF = Look("leaf", (Layer("Leaf", "pixar", {"clear": 0.3}),))

# The radiance of a look is the length of its name, on a worker that imports this module.
FLAT = """
import sys
from dataclasses import dataclass
import numpy as np
from lookdev.rendering.answers import AnswerStream
from lookdev.rendering.backends import BACKENDS, Backend
from lookdev.rendering.frame import RenderedFrame
from lookdev.rendering.wire import decode_frame_task

@dataclass(frozen=True)
class FlatSource:
    name: str
    level: float
    attributes: tuple = ()
    images: tuple = ()
    transmits: bool = False
    see_through: bool = False

    @property
    def digest(self):
        return f"flat {self.level}"

BACKENDS["flat"] = Backend(
    name="flat",
    help="one colour",
    command=(sys.executable, __file__),
    source=FlatSource,
    generate=lambda look, setting: FlatSource(look.name, float(len(look.name))),
    in_jobs=True,
    version=lambda: "1",
)

if __name__ == "__main__":
    answers = AnswerStream()
    answers.send_ready("flat 1")
    for line in sys.stdin:
        task = decode_frame_task(line)
        width, height = task.scene.resolution
        image = np.full((height, width, 3), task.scene.shaders[0].level, np.float32)
        answers.send_frame(task.digest, RenderedFrame(image, image, image[..., 0], 2, 0.0, 0.0))
"""


def scene_of(look: Look = LOOK, asset: str = "plane") -> Scene:
    return Scene.of_look(load_asset(builtin=asset), look, prepare_light(load_environment(builtin="studio")), (8, 8))


@pytest.mark.parametrize("backend", BACKENDS.values(), ids=BACKENDS)
def test_an_entry_is_whole_and_its_tasks_travel(backend: Backend) -> None:
    assert BACKENDS[backend.name] is backend
    assert backend.help
    assert "cpu" in backend.devices
    assert backend.look_gap(LOOK) is None
    task = frame_task(scene_task(scene_of(), Sampling(), backend.name), Pose(0.1, 0.2), "frame", seed=3)
    assert {type(source) for source in task.scene.shaders} == {backend.source}
    assert decode_frame_task(encode_task(task)) == task


@pytest.mark.parametrize("backend", BACKENDS.values(), ids=BACKENDS)
def test_a_look_is_shown_or_the_reason_is_given(backend: Backend) -> None:
    if reason := backend.look_gap(LEAF):
        with pytest.raises(CodegenError, match="one Disney layer") as caught:
            scene_task(scene_of(LEAF), Sampling(), backend.name)
        assert str(caught.value) == reason
    else:
        assert scene_task(scene_of(LEAF), Sampling(), backend.name).shaders


def test_sources_are_of_the_backend(scene: SceneTask) -> None:
    portal = replace(scene_task(scene_of(), Sampling(), "nodes").shaders[0], exact=True)
    for backend, sources, message in (
        ("exact", (), "takes a ShaderSource for every slot, found: none"),
        ("exact", (scene.shaders[0], generate_principled(LOOK)), "found: PrincipledSource, ShaderSource"),
        ("nodes", (portal,), "takes a NodeSource for every slot, found: NodeSource that is exact"),
    ):
        with pytest.raises(ValueError, match=f"'{backend}' .*{message}"):
            replace(scene, backend=backend, shaders=sources)


def test_a_convex_asset_has_no_bounces_unless_light_gets_inside() -> None:
    cases = itertools.product(("plane", "sphere", "shaderball"), (LOOK, LEAF))
    tasks = {(asset, look.name): scene_task(scene_of(look, asset), Sampling()) for asset, look in cases}
    assert {key for key, task in tasks.items() if not task.sampling.bounces} == {
        ("plane", "paint"), ("plane", "leaf"), ("sphere", "paint")
    }  # fmt: skip
    assert all(source.shadows == bool(task.sampling.bounces) for task in tasks.values() for source in task.shaders)  # type: ignore[attr-defined]


def test_contents_are_all_files() -> None:
    task = scene_task(scene_of(), Sampling())
    light = task.lights[0]
    assert files_of_task(task) == {
        task.asset,
        light.radiance_file,
        light.points_file,
        light.slots_file,
        light.bins_file,
    }
    image = Content("1", ".exr")
    textured = replace(task.shaders[0], textures=(TextureBinding("texture0_file", image),))  # type: ignore[type-var]
    assert files_of_task(replace(task, shaders=(textured,))) - files_of_task(task) == {image}


def test_a_backend_is_added_by_its_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "flat_backend.py").write_text(FLAT)
    monkeypatch.syspath_prepend(tmp_path)
    try:
        importlib.import_module("flat_backend")
        with open_renderer() as render:
            frame = render(frame_task(scene_task(scene_of(), Sampling(), "flat"), Pose(0.0, 0.0), "frame"))
        assert (frame.a == float(len("paint"))).all()
        (tmp_path / "look.usda").touch()
        job = job_toml("paint = look.usda", render='{ backend = "flat" }')
        assert parse_job(job, tmp_path / "job.toml").render.backend == "flat"
    finally:
        BACKENDS.pop("flat", None)
        sys.modules.pop("flat_backend", None)


def test_a_coat_is_a_quarter_as_strong() -> None:
    assert generate_principled(LOOK).inputs == {
        "Base Color": (0.46, 0.02, 0.02),
        "Metallic": 0.0,
        "Roughness": 0.4,
        "Coat Weight": 0.25,
        "Coat Roughness": pytest.approx(np.sqrt(0.0109)),
    }


def test_what_the_principled_bsdf_does_not_carry_is_refused() -> None:
    for inputs, message in (
        ({"roughness": Primvar("rough", 0.3)}, "constants, and roughness varies"),
        ({"sheen": 0.5}, "no sheen but its default"),
        ({"variant": "2012"}, "no variant but its default"),
    ):
        with pytest.raises(CodegenError, match=message):
            generate_principled(Look("look", (Layer("Base", "disney", inputs),)))
    with pytest.raises(CodegenError, match="one Disney layer, not 2 layers"):
        generate_principled(Look("look", LOOK.layers * 2))
