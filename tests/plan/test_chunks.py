import random
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations_with_replacement, pairwise
from typing import Any

import pytest

from lookdev.codegen.source import GeneratedSource, PrincipledSource
from lookdev.errors import LookdevError
from lookdev.plan.chunks import Chunk, Costs, Division, split_frames
from lookdev.plan.costs import estimate, frame_costs
from lookdev.rendering.task import SceneTask


def cost(scenes: list[int], costs: Costs, first: int, end: int) -> float:
    """Return the cost of a part with the frames `first` to before `end`."""
    changes = sum(number == first or scenes[number] != scenes[number - 1] for number in range(first, end))
    return sum(costs.frames[first:end]) + changes * costs.scene


def largest_cost(scenes: list[int], costs: Costs, ends: tuple[int, ...]) -> float:
    return max(cost(scenes, costs, first, end) for first, end in pairwise((0, *ends)))


@pytest.mark.parametrize("text", ["1/1", "2/8", "100000/100000", "2/48@8", "1/2@1"])
def test_a_chunk_is_read_as_it_is_written(text: str) -> None:
    assert str(Chunk.parse(text)) == text
    assert Chunk.parse("2/8@8") == Chunk.parse("2/8")  # a chunk for each machine is one of like cost


NO_CHUNKS = ["", "0/3", "4/3", "1", "1/0", "-1/3", "1/3/5", "a/b", "1/100001", "1/3 ", "١/٣", "1/3@0", "1/3@4", "1/3@"]
NO_DIVISIONS = ["0", "-1", "8@9", "8@0", "8@", "eight", "100001", "8 "]


@pytest.mark.parametrize(
    ("parse", "text", "message"),
    [(Chunk.parse, text, "is not a chunk: 2/8 is the second of eight") for text in NO_CHUNKS]
    + [(Division.parse, text, "is not a number of chunks: 8 are eight of equal cost") for text in NO_DIVISIONS],
)
def test_other_text_is_refused(parse: Callable[[str], object], text: str, message: str) -> None:
    with pytest.raises(LookdevError, match=message):
        parse(text)


@pytest.mark.parametrize("seed", range(20))
def test_no_division_has_a_cheaper_most_costly_part(seed: int) -> None:
    rng = random.Random(seed)
    scenes = sorted(rng.randrange(3) for _ in range(8))
    costs = Costs(tuple(rng.uniform(0.1, 3.0) for _ in scenes), rng.uniform(0.0, 4.0), 1.0)
    count = rng.randint(1, 4)
    ends = split_frames(scenes, costs, Division(count))
    assert (len(ends), ends[-1]) == (count, len(scenes))
    divisions = combinations_with_replacement(range(len(scenes) + 1), count - 1)
    best = min(largest_cost(scenes, costs, (*inner, len(scenes))) for inner in divisions)
    assert largest_cost(scenes, costs, ends) == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("division", ["1", "2@1", "3"])
def test_every_frame_is_in_a_part_however_sums_are_rounded(division: str) -> None:
    for seed in range(50):
        rng = random.Random(seed)
        costs = Costs(tuple(rng.uniform(0.1, 3.0) for _ in range(300)), 1.3, 1.0)
        ends = split_frames([number // 100 for number in range(300)], costs, Division.parse(division))
        assert (len(ends), ends[-1]) == (Division.parse(division).count, 300)


def test_scenes_stay_together_where_that_costs_nothing() -> None:
    scenes = [scene for scene in range(6) for _ in range(10)]
    assert split_frames(scenes, Costs((1.0,) * 60, 4.0, 6.0), Division(3)) == (20, 40, 60)


def test_parts_do_not_depend_on_the_unit_of_costs() -> None:
    costs = Costs((3.0, 1.0, 2.0, 1.0, 1.0, 4.0), 0.5, 1.0)
    small = Costs(tuple(1e-9 * seconds for seconds in costs.frames), 1e-9 * costs.scene, 1.0)
    assert split_frames([0] * 6, small, Division(3)) == split_frames([0] * 6, costs, Division(3))


@pytest.mark.parametrize(("frames", "count"), [(0, 3), (2, 5), (7, 7)])
def test_parts_without_frames_are_the_last(frames: int, count: int) -> None:
    ends = split_frames([0] * frames, Costs((1.0,) * frames, 1.0, 1.0), Division(count))
    assert ends == tuple(min(number, frames) for number in range(1, count + 1))


def test_parts_for_fewer_machines_fall_in_rounds() -> None:
    ends = split_frames([0] * 4032, Costs((1.0,) * 4032, 0.0, 1.0), Division.parse("24@4"))
    sizes = [end - first for first, end in pairwise((0, *ends))]
    # 4 (1 + 1/2 + ... + 1/32) of the first.
    assert all(abs(size - 512 / 2 ** (number // 4)) <= 1 for number, size in enumerate(sizes))
    weights = Division.parse("80@4").weights
    assert weights[-1] == pytest.approx(1 / 32)
    assert all(later <= earlier for earlier, later in pairwise(weights))


def test_scenes_that_were_not_measured_are_estimated_in_the_ratio_of_the_others(scene: SceneTask) -> None:
    other = replace(scene, sampling=replace(scene.sampling, samples=4 * scene.sampling.samples))
    frames = [scene, scene, other]
    assert frame_costs(frames, [None, None, None]) == [estimate(scene), estimate(scene), estimate(other)]
    assert frame_costs(frames, [3.0, None, None]) == pytest.approx([3.0, 3.0, 3.0 * estimate(other) / estimate(scene)])
    assert frame_costs(frames, [3.0, 5.0, None])[2] == pytest.approx(4.0 * estimate(other) / estimate(scene))


def test_an_estimate_is_for_a_frame_and_each_of_its_samples(scene: SceneTask) -> None:
    def seconds(
        shaders: tuple[GeneratedSource, ...], size: tuple[int, int] = (64, 48), backend: str = "exact", **values: Any
    ):
        sampling = replace(scene.sampling, **{"samples": 100, "bounces": 0, **values})
        return estimate(replace(scene, backend=backend, resolution=size, sampling=sampling, shaders=shaders))

    def directions(*count: int, transmits: bool = False) -> tuple[GeneratedSource, ...]:
        return (replace(scene.shaders[0], directions=count, transmits=transmits),)  # type: ignore[type-var]

    usual = directions(2, 6)
    frame = seconds(usual, (0, 48))
    sample = seconds(usual) - frame
    assert frame > 0.0
    assert sample > 0.0
    for work, times in [
        (seconds(usual, (128, 48)), 2.0),
        (seconds(usual, (64, 96)), 2.0),
        (seconds(usual, samples=300), 3.0),
        (seconds(usual, samples=300, error=1e-3), 2.56),  # what a target usually takes
        (seconds(usual, samples=50, error=1e-3), 0.5),
        (seconds(usual, bounces=2), 2.0),
        (seconds(directions(6, 10)), 1.75),
        (seconds(directions(0, 0)), 0.25),
        (seconds(directions(2, 6, transmits=True)), 1.8),
        (seconds(usual + directions(0, 0)), 0.625),
        (seconds((PrincipledSource("p", {}),), backend="principled"), 1.0),
    ]:
        assert work - frame == pytest.approx(times * sample)


def test_a_frame_s_own_time_is_its_cost_and_its_scene_s_mean_that_of_the_others(scene: SceneTask) -> None:
    assert frame_costs([scene] * 3, [2.0, None, 4.0]) == [2.0, 3.0, 4.0]
