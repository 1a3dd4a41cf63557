"""Fixtures and hooks that the tests of several packages share: render workers for the whole run, a small scene, a job.

It also distributes the tests to the processes of pytest-xdist.
"""

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.asset import load_asset
from lookdev.cache import Content, take_notes
from lookdev.codegen.source import (
    AttributeBinding,
    GroupSocket,
    NodeLink,
    NodeSource,
    NodeTree,
    ShaderNode,
    ShaderSource,
    TextureBinding,
)
from lookdev.errors import RenderError
from lookdev.job import Job, parse_job
from lookdev.light import Dome, load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.plan import Setup
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.llvm import LLVM_VARIABLE, find_llvm
from lookdev.rendering.task import SceneTask
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Sampling, Scene

pytest_plugins = ["home", "chromium", "stored_references", "failed_pictures", "warm_blender"]

# Session fixtures that are expensive to start. All test files that use one of them run in the same process of
# pytest-xdist, so that it is started once.
SHARED = ("cycles_worker", "mitsuba_worker", "browser")
DURATIONS = Path(__file__).parent / "durations.json"  # written by tests/durations.py
LONGEST_ID = 100  # characters of a text in the name of a test

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


@pytest.hookimpl(tryfirst=True)  # before plugins that order the tests at random
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Group the tests for the processes of pytest-xdist, and start with the group that takes longest.

    All tests of a file are in one group, together with the other files that use the same fixture of `SHARED`.
    """
    groups: dict[Path, str] = {}  # the name of the group of each file
    for item in items:
        groups.setdefault(item.path, item.path.name)
        groups[item.path] = next((name for name in SHARED if name in item.fixturenames), groups[item.path])  # type: ignore[attr-defined]
    # `durations` maps a file to the number of its tests and their seconds; `seconds` are those of each group.
    durations, seconds = json.loads(DURATIONS.read_text())["3.11"]["files"], dict.fromkeys(groups.values(), 0.0)
    for path, group in groups.items():
        seconds[group] += durations.get(path.relative_to(DURATIONS.parent).as_posix(), (0, 0.0))[1]
    for item in items:
        item.add_marker(pytest.mark.xdist_group(groups[item.path]))
    items.sort(key=lambda item: (-seconds[groups[item.path]], groups[item.path]))


def pytest_make_parametrize_id(val: object) -> str | None:
    """Shorten a long text in the name of a parametrized test: some parameters are files of megabytes."""
    if not isinstance(val, str | bytes) or len(val) <= LONGEST_ID:
        return None
    return f"{val[:LONGEST_ID]!r}..."


@pytest.fixture(scope="session")
def cycles_worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    """A worker of Cycles for the whole run; if a test has ended it, its method `start` starts it again."""
    folder = tmp_path_factory.mktemp("cycles")
    with Worker(BACKENDS["exact"].command, folder / "worker.log", folder, 300.0) as worker:
        yield worker


@pytest.fixture(scope="session")
def llvm() -> str:
    """Return the path of an LLVM for Mitsuba and Dr.Jit; skip the test if there is none."""
    try:
        return find_llvm()
    except RenderError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def drjit(llvm: str):
    """The module `drjit` in this process, with the LLVM of the fixture `llvm`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(LLVM_VARIABLE, llvm)
        yield pytest.importorskip("drjit")


@pytest.fixture(scope="session")
def mitsuba_worker(llvm: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    """A worker of Mitsuba for the whole run; tests are skipped if there is no LLVM for its kernels."""
    folder = tmp_path_factory.mktemp("mitsuba")
    with Worker(BACKENDS["mitsuba"].command, folder / "worker.log", folder, 300.0) as worker:
        yield worker


@pytest.fixture(autouse=True)
def _no_notes() -> None:
    """Discard the notes about damaged files of the cache that the test before has left."""
    take_notes()


@pytest.fixture
def scene() -> SceneTask:
    """Return the task of a small scene, whose files do not exist."""
    osl = 'shader gold() {\n\t"quoted \u03b1"\r\n}\n'
    texture, attribute = TextureBinding("base_file", Content("7e87", ".exr")), AttributeBinding("st", "st", "uv")
    return SceneTask(
        asset=Content("a55e7", ".npz"),
        backend="exact",
        shaders=(ShaderSource("gold", osl, (texture,), (attribute,), "500d"),),
        slot_shaders=(0,),
        lights=(Dome(*(Content(part, ".exr") for part in "rpsb"), 1024, 512, "119147"),),
        resolution=(64, 48),
        sampling=Sampling(brdf_samples=2, ibl_samples=4),
        camera=Camera(fov=39.6, elevation=10.0, target=(0.1, 0.2, 1 / 3), distance=3.7),
    )


Tasks = Mapping[tuple[str, str], SceneTask]
"""Tasks by look and light."""


@pytest.fixture
def make_setups(scene: SceneTask) -> Callable[..., list[Setup]]:
    """Return a function that makes a setup for each look and light of a job, from tasks by look and light.

    All setups have the same scene. `around` has the pairs of look and light that look the same from all sides.
    """
    asset = load_asset(builtin="plane")

    def make(job: Job, tasks: Tasks, around: Collection[tuple[str, str]] = (), look: Look | None = None) -> list[Setup]:
        shown = Scene.of_look(asset, look or Look("gold", (Layer("Base", "disney"),)), scene.lights[0], (64, 48))
        sampling = job.render.sampling
        return [
            Setup(*key, shown, tasks[key], sampling, key in around, ibl.exposure, ibl.rotation)
            for job_look in job.look
            for ibl in job.ibl
            if (key := (job_look.name, ibl.name))
        ]

    return make


@pytest.fixture
def node_source() -> NodeSource:
    """Return a source of native shader nodes whose sockets and properties have every type of value."""
    group = NodeTree(
        "Lookdev Disney",
        (
            ShaderNode("In", "NodeGroupInput"),
            ShaderNode("Map", "TexImage", {"extension": "CLIP"}, {}, "t \u00e9", image=Content("7e87", ".exr")),
            ShaderNode(
                "Mix",
                "Mix",
                {"clamp_factor": False, "clamp_result": True, "data_type": "RGBA"},
                {"Factor_Float": 0.1, "A_Color": (0.2, 1 / 3, 0.4), "B_Color": NodeLink("In", "baseColor")},
                position=(-200.0, 1.5),
            ),
        ),
        (GroupSocket("baseColor", "color", (0.8, 0.7, 0.6), (0.0, 1.0), "The colour.", "Base"),),
        (GroupSocket("BSDF", "shader"),),
    )
    material = NodeTree("gold", (ShaderNode("Disney", "Group", group="Lookdev Disney"),))
    attributes = (AttributeBinding("wear", "wear", "float", (0.5,)),)
    return NodeSource("gold", (group, material), attributes, "40de5", exact=False, transmits=True)


@pytest.fixture(scope="session")
def light_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Dome]:
    """Return a function that prepares a built-in light by its name, or the light ``slopes``.

    The colour of ``slopes`` varies slowly, by a factor of three. Tests that do not sample the light need this: small
    bright lamps would make noise that does not follow Student's t. The first and the last row of its map are alike,
    because Cycles' world interpolates between them at a pole.
    """
    azimuth, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 129)[:-1], np.linspace(1.0, -1.0, 64))
    channels = (1.0 + 0.5 * np.sin(azimuth), 1.0 + 0.5 * np.cos(azimuth), 1.0 + 0.5 * np.cos(np.pi * height))
    slopes = tmp_path_factory.mktemp("light") / "slopes.exr"
    assert oiio.ImageBuf(np.stack(channels, axis=-1).astype(np.float32)).write(str(slopes))
    return lambda name: prepare_light(load_environment(slopes) if name == "slopes" else load_environment(builtin=name))


@pytest.fixture
def make_job(tmp_path: Path) -> Callable[..., Job]:
    """Return a function that parses the text `JOB`, with more text appended."""

    def make(more: str = "") -> Job:
        (tmp_path / "gold.usda").touch()
        return parse_job(JOB + more, tmp_path / "job.toml")

    return make
