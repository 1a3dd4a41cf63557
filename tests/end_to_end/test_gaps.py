"""The distances of native nodes from the exact pictures in docs/nodes.md."""

import numpy as np
import pytest
from gaps import PRESETS, ROOT, measure, read

from lookdev.checks.images import MAX_FLIP
from lookdev.rendering.worker import Worker


def test_every_preset_is_recorded_and_near() -> None:
    gaps = read()
    assert sorted(gap.preset for gap in gaps) == [preset.stem for preset in PRESETS]
    assert max(gap.albedo for gap in gaps) < 0.01
    assert np.mean([gap.flip for gap in gaps]) < MAX_FLIP


def test_those_that_are_further_away_are_named_with_the_reason() -> None:
    page = (ROOT / "docs" / "nodes.md").read_text(encoding="utf-8")
    text = page[: page.index("<!-- table: nodes.gaps -->")] + page[page.index("<!-- end -->") :]
    for gap in read():
        assert (gap.flip > MAX_FLIP) == (f"`{gap.preset}`" in text), gap


@pytest.mark.cycles
@pytest.mark.proof
@pytest.mark.parametrize("place", [0, 20, 40, 60])
def test_what_is_recorded_is_measured_again(place: int, cycles_worker: Worker) -> None:
    recorded = read()[place]
    (preset,) = (preset for preset in PRESETS if preset.stem == recorded.preset)
    cycles_worker.start()
    found = measure(preset, lambda task: cycles_worker.render(task, lambda progress: None))
    # Blender 5.2 draws other samples: what differs is noise.
    assert abs(found.flip - recorded.flip) < 0.5 * max(found.flip_noise, recorded.flip_noise)
    assert found.albedo < 0.01
