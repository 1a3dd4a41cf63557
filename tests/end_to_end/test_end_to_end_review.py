"""Frames of the real renderer against those of other seeds and of a look that is hardly rougher."""

from itertools import combinations
from pathlib import Path

import batches
import numpy as np
import pytest

from lookdev.metrics import noise_ratio
from lookdev.output.review.pixels import CHANGED_SHARE, NOISE_LIMIT, SQUARE, PremultipliedPixels, read_pixels
from lookdev.run.render import render_job

pytestmark = [pytest.mark.cycles, pytest.mark.usefixtures("warm")]


def rendered(folder: Path, seed: int, roughness: float = 0.3) -> PremultipliedPixels:
    folder.mkdir()
    job = batches.write_job(
        folder,
        asset='{ builtin = "shaderball" }',
        look='[{ name = "red", material = "red.usda" }]',
        turntable='[{ kind = "element", frames = 1, start = 150 }]',
        render=f"{{ resolution = [112, 84], samples = 32, bounces = 0, seed = {seed} }}",
    )
    batches.write_look(folder, "red", (0.7, 0.1, 0.1), roughness=roughness, specular=0.5, metallic=0.5)
    assert render_job(job).exit_code == 0
    return read_pixels(folder / "out" / "red" / "studio" / "element.0001.exr")


def beyond(a: PremultipliedPixels, b: PremultipliedPixels, size: int) -> float:
    """Return the share of the asset's pixels that noise does not explain."""
    assert a.error is not None
    assert b.error is not None
    z = noise_ratio(a.beauty, b.beauty, a.error, b.error, size)
    return float((z[np.maximum(a.alpha, b.alpha) > 0] > NOISE_LIMIT).mean())


def test_other_seeds_show_nothing_and_two_hundredths_of_roughness_show(tmp_path: Path) -> None:
    frames = [rendered(tmp_path / str(seed), seed) for seed in (1, 2, 3)]
    first, second = frames[:2]
    assert not np.array_equal(first.beauty, second.beauty)
    # One outlier among the pixels is a whole square beyond: the share is that of all pairs.
    for size in (1, SQUARE):
        assert np.mean([beyond(a, b, size) for a, b in combinations(frames, 2)]) <= CHANGED_SHARE
    rougher = rendered(tmp_path / "rougher", 5, roughness=0.32)
    assert beyond(first, rougher, SQUARE) > 10.0 * CHANGED_SHARE
