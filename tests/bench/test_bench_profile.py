"""Shares of a second, by renderers that take as long as their shaders are; and stages that render."""

import json
from pathlib import Path

import numpy as np
import pytest
from bench_fakes import FakeProcesses, quiet

from lookdev.bench.benchmark import SECTION_END, section_marker
from lookdev.bench.options import BenchOptions, Cell, parse_options
from lookdev.bench.profile import FEW_SAMPLES, PARTS, ProfileBenchmark, stages_of
from lookdev.bench.reference import timed_picture
from lookdev.bench.subjects import POSE
from lookdev.errors import LookdevError
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import Worker

DEFAULTS = ProfileBenchmark.DEFAULTS
FIXED, FILM = 0.01, 0.001  # seconds of a frame, and of a sample


def seconds_of(task: FrameTask) -> float:
    """A sample takes a millisecond for each thousand characters of the shader, and with rays and bounces more."""
    (shader,) = task.scene.shaders
    empty = not shader.attributes and len(shader.osl) < 1000
    cost = 1e-6 * len(shader.osl) + 0.01 * shader.shadows + 0.005 * task.scene.sampling.bounces
    return FIXED + task.scene.sampling.samples * (FILM + (0.0 if empty else cost))


def options(**lists: str) -> BenchOptions:
    return parse_options({"scenes": "shaderball", "looks": "metal", **lists}, defaults=DEFAULTS, repeats=2)


@pytest.fixture
def document(tmp_path: Path) -> Path:
    file = tmp_path / "bench.md"
    file.write_text(f"before\n{section_marker('profile')}\nold\n{SECTION_END}\nafter\n")
    return file


def run(document: Path, options: BenchOptions, processes: FakeProcesses | None = None) -> ProfileBenchmark:
    opened = processes or FakeProcesses(seconds_of)
    benchmark = ProfileBenchmark(options=options, report=quiet, open_process=opened)
    benchmark.run(document.parent / "out", document)
    return benchmark


def test_the_shares_add_up_and_are_those_of_what_was_left_out(document: Path, tmp_path: Path) -> None:
    profile = run(document, options())
    assert profile.complete
    (cell,) = profile.cells
    assert tuple(cell.parts) == PARTS
    seconds = {name: middle * cell.seconds for name, (middle, _, _) in cell.parts.items()}
    assert sum(seconds.values()) == pytest.approx(cell.seconds)
    assert seconds["Blender, whatever the samples"] == pytest.approx(FIXED)
    assert seconds["camera rays and film"] == pytest.approx(64 * FILM)
    assert seconds["indirect light: paths after the first hit"] == pytest.approx(64 * 0.01, rel=0.01)
    assert seconds["rays towards the light"] == pytest.approx(64 * 0.01, rel=0.01)
    # Each of the other parts is some text of the shader.
    assert all(value > 0.0 for value in seconds.values())
    text = document.read_text()
    assert text.startswith(f"before\n{section_marker('profile')}")
    assert text.endswith(f"{SECTION_END}\nafter\n")
    assert "A part of the profile: scenes, looks, repeats are not the defaults." in text
    for name, (middle, _, _) in cell.parts.items():
        assert f"| {name} | {1000.0 * middle:.0f} |" in text
    assert json.loads((tmp_path / "out" / "profile.json").read_text())["cells"][0]["look"] == "metal"


def test_what_a_shader_lacks_has_no_share() -> None:
    parts = [stage.part for stage in stages_of(Cell("sphere", "studio", "plastic"), 16)]
    assert "rays towards the light" not in parts
    assert "indirect light: paths after the first hit" not in parts
    assert parts[0] == "all"


def test_every_stage_lacks_what_the_one_before_it_has() -> None:
    stages = stages_of(Cell("shaderball", "studio", "copper"), 16)
    sources = [stage.scene.shaders[0] for stage in stages]
    assert [stage.part for stage in stages] == ["all", *PARTS[:-1]]
    assert [stage.has_few_samples for stage in stages] == [False] * (len(stages) - 1) + [True]
    assert [source.shadows for source in sources[:3]] == [True, True, False]
    # The numbers of directions are those of the whole.
    assert len({source.directions for source in sources[:-2]}) == 1
    assert len({source.digest for source in sources}) == len(sources) - 1


def test_ctrl_c_and_failures_leave_what_was_measured(document: Path) -> None:
    per_cell = 3 * len(stages_of(Cell("shaderball", "studio", "metal"), 96))
    both = options(looks="metal,copper")
    profile = run(document, both, FakeProcesses(seconds_of, ends_after=per_cell + 5))
    assert not profile.complete
    assert [cell.look for cell in profile.cells] == ["metal"]
    assert "Not complete" in document.read_text()
    profile = run(document, both, FakeProcesses(seconds_of, fails="metal"))
    assert profile.complete
    assert profile.failures == ["shaderball, studio, metal: no ink"]
    assert "- shaderball, studio, metal: no ink" in document.read_text()


@pytest.mark.cycles
@pytest.mark.parametrize(
    ("look", "between"),
    [("metal", False), *(pytest.param(look, True, marks=pytest.mark.proof) for look in ("metal", "plastic"))],
)
def test_stages_render(look: str, between: bool, cycles_worker: Worker) -> None:
    """In each a part is missing, and nothing else; `between` the first three and the last too."""
    cycles_worker.start()
    shots, every = [], stages_of(Cell("shaderball", "studio", look), 24)
    for number, stage in enumerate(every if between else every[:3] + every[-1:]):
        task = frame_task(stage.scene, POSE, f"{number}", samples=16)
        shots.append(timed_picture(cycles_worker.render(task, lambda progress: None)))
    whole = shots[0]
    covered = whole.alpha > 0.99
    for shot in shots:
        # The same rays of the camera, whatever is shown.
        np.testing.assert_array_equal(shot.alpha, whole.alpha)
        assert shot.image[covered].mean() > 0.0
    means = [float(shot.image[covered].mean()) for shot in shots]
    # Without bounces light is missing; without rays none is occluded.
    assert means[1] < means[0]
    assert means[2] > means[1]
    for shot in shots[-2:] if between else shots[-1:]:
        np.testing.assert_allclose(shot.image[covered], 1.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("lists", "message"),
    [
        ({"ibls": "studio+3"}, "not of rigs: studio+3"),
        ({"samples": "16,64"}, "one number of samples"),
        ({"samples": str(FEW_SAMPLES)}, f"more than {FEW_SAMPLES}"),
    ],
)
def test_wrong_options_are_refused(lists: dict[str, str], message: str, document: Path) -> None:
    processes = FakeProcesses(seconds_of)
    with pytest.raises(LookdevError, match=message.replace("+", r"\+")):
        run(document, options(**lists), processes)
    assert processes.tasks == []
