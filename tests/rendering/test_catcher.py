"""Frames with a shadow catcher, composed of their parts."""

import numpy as np

from lookdev.rendering.adaptive import Half, Region
from lookdev.rendering.catcher import combine_catcher_halves, remaining_share

SIZE = (6, 5)


def halves(rng: np.random.Generator) -> list[Half]:
    """Return halves of an asset and ground, whose light the asset lowers, raises or leaves as it is."""
    halves_of_frame = []
    coverage = rng.uniform(0.0, 1.0, SIZE[::-1])
    ratio = rng.uniform(0.0, 1.5, (*SIZE[::-1], 3))
    ratio[0] = 1.0
    for _ in range(2):
        half = Half(*SIZE)
        bare = coverage[..., None] * rng.uniform(0.2, 0.4, (*SIZE[::-1], 3))
        bare[1] = 0.0  # no light
        asset = (1.0 - coverage)[..., None] * rng.uniform(0.0, 1.0, (*SIZE[::-1], 3))
        parts = {"ground": ratio * bare, "bare": bare, "covered": np.repeat(coverage[..., None], 3, axis=-1)}
        region = Region(slice(0, SIZE[1]), slice(0, SIZE[0]), 8)
        half.add(region, asset + ratio * bare, np.ones(SIZE[::-1], np.float32), parts)
        halves_of_frame.append(half)
    return halves_of_frame


def test_laid_over_its_ground_a_frame_is_asset_and_ground() -> None:
    first, second = halves(np.random.default_rng(2))
    a, b, alpha = combine_catcher_halves(first, second)
    covered = first.parts["covered"][..., 0] / first.samples
    bare = 0.5 * (first.parts["bare"] / first.samples[..., None] + second.parts["bare"] / second.samples[..., None])
    # Asset and ground fill each pixel, of which the picture of the ground has its colour everywhere.
    plate = bare / covered[..., None]
    composite = 0.5 * (a + b) + (1.0 - alpha)[..., None] * plate
    np.testing.assert_allclose(composite, 0.5 * (first.color + second.color), atol=1e-12)
    # Where the asset changes nothing, or no light arrives, nothing of the ground is in the frame.
    np.testing.assert_allclose(alpha[:2], 1.0 - covered[:2], atol=1e-12)
    # Colour is never negative.
    assert (0.5 * (a + b)).min() > -1e-12


def test_what_remains_is_the_least_of_all_channels() -> None:
    for ground, bare, share in (
        ((0.2, 0.9, 0.5), (1.0, 1.0, 1.0), 0.2),  # the rest of green and blue is colour
        ((2.0, 3.0, 1.5), (1.0, 1.0, 1.0), 1.0),  # more light than without the asset
        ((0.5, 0.0, 0.5), (1.0, 0.0, 1.0), 0.5),  # a channel without light tells nothing
        ((0.3, 0.3, 0.3), (0.0, 0.0, 0.0), 1.0),
        ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0),
    ):
        assert remaining_share(np.array(ground), np.array(bare)) == share, (ground, bare)
