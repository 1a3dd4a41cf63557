"""Shares of a second, by renderers that take as long as their shaders are."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bench_fakes import quiet

from lookdev.bench.document import END, marker
from lookdev.bench.kinds import KINDS
from lookdev.bench.matrix import Cell, Options, parse_options, restricted
from lookdev.bench.profile import FEW, PARTS, run_profile, stages
from lookdev.errors import LookdevError, RenderError
from lookdev.render.results import Rendered
from lookdev.render.task import FrameTask

DEFAULTS = KINDS["profile"].defaults
FIXED, FILM = 0.01, 0.001  # seconds of a frame, and of a sample


class FakeProcesses:
    """A sample takes a millisecond for each thousand characters of the shader, and with rays and bounces more."""

    def __init__(self, ends_after: int | None = None, fails: str = "") -> None:
        self.frames = 0
        self._ends_after, self._fails = ends_after, fails

    @contextmanager
    def __call__(self) -> Iterator[Callable[[FrameTask], Rendered]]:
        yield self.render

    def render(self, task: FrameTask) -> Rendered:
        self.frames += 1
        if self._ends_after is not None and self.frames > self._ends_after:
            raise KeyboardInterrupt
        (shader,) = task.scene.shaders
        if shader.name == self._fails:
            raise RenderError("no ink")
        samples = task.scene.sampling.samples
        seconds = FIXED + samples * (FILM + self.cost(task))
        black = np.zeros((8, 8, 3), np.float32)
        return Rendered(black, black, black[..., 0], samples, seconds, 0.0, "fake", 1)

    @staticmethod
    def cost(task: FrameTask) -> float:
        (shader,) = task.scene.shaders
        empty = not shader.attributes and len(shader.osl) < 1000
        return 0.0 if empty else 1e-6 * len(shader.osl) + 0.01 * shader.shadows + 0.005 * task.scene.sampling.bounces


def options(**given: str) -> Options:
    return parse_options({"scenes": "shaderball", "looks": "metal", **given}, defaults=DEFAULTS, repeats=2)


@pytest.fixture
def document(tmp_path: Path) -> Path:
    file = tmp_path / "bench.md"
    file.write_text(f"before\n{marker('profile')}\nold\n{END}\nafter\n")
    return file


def test_the_shares_add_up_and_are_those_of_what_was_left_out(document: Path, tmp_path: Path) -> None:
    chosen = options()
    part = restricted(chosen, DEFAULTS)
    profile = run_profile(chosen, tmp_path / "out", quiet, document=document, restricted=part, opened=FakeProcesses())
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
    assert text.startswith(f"before\n{marker('profile')}")
    assert text.endswith(f"{END}\nafter\n")
    assert "A part of the profile: scenes, looks, repeats are not the defaults." in text
    for name, (middle, _, _) in cell.parts.items():
        assert f"| {name} | {1000.0 * middle:.0f} |" in text
    assert json.loads((tmp_path / "out" / "profile.json").read_text())["cells"][0]["look"] == "metal"


def test_what_a_shader_lacks_has_no_share() -> None:
    parts = [each.part for each in stages(Cell("sphere", "studio", "plastic"), 16)]
    assert "rays towards the light" not in parts
    assert "indirect light: paths after the first hit" not in parts
    assert parts[0] == "all"


def test_every_stage_lacks_what_the_one_before_it_has() -> None:
    made = stages(Cell("shaderball", "studio", "copper"), 16)
    sources = [each.scene.shaders[0] for each in made]
    assert [each.part for each in made] == ["all", *PARTS[:-1]]
    assert [each.few for each in made] == [False] * (len(made) - 1) + [True]
    assert [source.shadows for source in sources[:3]] == [True, True, False]
    # The numbers of directions are those of the whole.
    assert len({source.directions for source in sources[:-2]}) == 1
    assert len({source.digest for source in sources}) == len(sources) - 1


def test_ctrl_c_and_failures_leave_what_was_measured(document: Path, tmp_path: Path) -> None:
    per_cell = 3 * len(stages(Cell("shaderball", "studio", "metal"), 96))
    both = options(looks="metal,copper")
    ended = FakeProcesses(ends_after=per_cell + 5)
    profile = run_profile(both, tmp_path / "out", quiet, document=document, opened=ended)
    assert not profile.complete
    assert [each.look for each in profile.cells] == ["metal"]
    assert "Not complete" in document.read_text()
    failing = FakeProcesses(fails="metal")
    profile = run_profile(both, tmp_path / "out", quiet, document=document, opened=failing)
    assert profile.complete
    assert profile.failures == ["shaderball, studio, metal: no ink"]
    assert "- shaderball, studio, metal: no ink" in document.read_text()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"ibls": "studio+3"}, "not of rigs: studio+3"),
        ({"samples": "16,64"}, "one number of samples"),
        ({"samples": str(FEW)}, f"more than {FEW}"),
    ],
)
def test_wrong_options_are_refused(given: dict[str, str], message: str, document: Path, tmp_path: Path) -> None:
    processes = FakeProcesses()
    with pytest.raises(LookdevError, match=message.replace("+", r"\+")):
        run_profile(options(**given), tmp_path / "out", quiet, document=document, opened=processes)
    assert processes.frames == 0
