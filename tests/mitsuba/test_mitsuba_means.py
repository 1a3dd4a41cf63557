"""Means of frames against the float64 reference, to .1 %: every kind of light and control, textured stacks, all models.

The mean of a frame is a frame of one pixel, or of a few. The reference samples each of these with one low-discrepancy
set, so that its error is a tenth of that of the same number of points in sets for small pixels.

    python -m pytest -n 0 -m proof tests/mitsuba/test_mitsuba_means.py --log-cli-level INFO
"""

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from light_rigs import RIG_LOOKS, RIGS, row_of_three
from mitsuba_scenes import scene_with_look
from painted import embossed, painted, sparkling

from lookdev.brdf import CONTINUOUS_MODELS, MODELS
from lookdev.light import Dome
from lookdev.material import Layer
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Film, Pose, Sampling, Scene

pytestmark = [pytest.mark.mitsuba, pytest.mark.proof]

POSE = Pose(0.0, 20.0)  # lamps shine on what the camera sees
SIZE, SAMPLES, POINTS = 16, 2048, 1 << 18
LEAST, MOST, ENOUGH = 8, 128, 2e-4
"""The fewest and the most independent values of a mean, and the relative standard error that ends the sampling."""

LightOf = Callable[[str], Dome]


def scene_of(name: str, light_of: LightOf, folder: Path) -> Scene:
    """Return the scene of a case, whose name is ``kind: detail``."""
    kind, _, detail = name.partition(": ")
    match kind:
        case "dome":
            return scene_with_look("sphere", (RIG_LOOKS["plastic"],), light_of(detail), size=SIZE)
        case "light":
            return scene_with_look("sphere", (RIG_LOOKS["plastic"],), *RIGS[detail](folder), size=SIZE)
        case "links":
            return replace(row_of_three(SIZE), film=Film((3 * SIZE, SIZE)))
        case "model":
            return scene_with_look(
                "sphere", (Layer("Layer", detail, MODELS[detail].probe),), light_of("city"), size=SIZE
            )
    layers = {"painted": painted, "sparkling": sparkling, "embossed": embossed}[detail](folder)
    return scene_with_look("suzanne", layers, light_of("city"), size=SIZE)


CASES = (
    *(f"dome: {light}" for light in ("white", "slopes", "city", "studio")),
    *(f"light: {rig}" for rig in RIGS),
    "links: three heads, shadows of some",
    *(f"stack: {stack}" for stack in ("painted", "sparkling", "embossed")),
    *(f"model: {model}" for model in CONTINUOUS_MODELS),
)


@pytest.fixture(scope="module")
def scene(light_of: LightOf, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Scene]:
    folder = tmp_path_factory.mktemp("scenes")
    return cache(lambda name: scene_of(name, light_of, folder))


@pytest.fixture(scope="module")
def reference(scene: Callable[[str], Scene]) -> Callable[[str], tuple[float, float]]:
    """Return a function from a case to the mean of its frame over pixels and channels, and the standard error."""

    @cache
    def mean(name: str) -> tuple[float, float]:
        case = scene(name)
        shape = MeshScene(case.asset, case.looks, case.slot_lights, case.slot_groups)

        squares = case.film.resolution[0] // SIZE
        pixels = np.stack([np.arange(squares), np.zeros(squares, np.int64)], axis=-1)

        def frame(seed: int) -> list[float]:
            pixel_means = frame_pixels(
                shape, case.lights, case.camera, POSE, (squares, 1), pixels,
                bounces=bounces_of(name), samples=POINTS, scrambles=2, seed=seed,
            )  # fmt: skip
            return [float(pixel_means.value.mean())]

        return converged_mean(frame)

    return mean


def converged_mean(values: Callable[[int], list[float]]) -> tuple[float, float]:
    """Return the mean of independent values of seeds, and its standard error, at most `ENOUGH` times the mean."""
    means: list[float] = []
    for seed in range(MOST):
        means += values(seed)
        error = np.std(means, ddof=1) / np.sqrt(len(means)) if len(means) >= LEAST else np.inf
        if error < ENOUGH * abs(np.mean(means)):
            return float(np.mean(means)), float(error)
    raise AssertionError(f"{MOST} seeds leave an error of {error}")


def bounces_of(name: str) -> int:
    return 2 if name.startswith("stack") else 0


@pytest.fixture(params=["mitsuba", pytest.param("exact", marks=pytest.mark.cycles)])
def renderer(request: pytest.FixtureRequest) -> tuple[str, Worker]:
    worker: Worker = request.getfixturevalue("mitsuba_worker" if request.param == "mitsuba" else "cycles_worker")
    worker.start()
    return request.param, worker


@pytest.mark.parametrize("name", CASES)
def test_means_are_those_of_the_reference(
    name: str,
    renderer: tuple[str, Worker],
    scene: Callable[[str], Scene],
    reference: Callable[[str], tuple[float, float]],
) -> None:
    backend, process = renderer
    task = scene_task(scene(name), Sampling(bounces=bounces_of(name), samples=SAMPLES), backend)

    def halves(seed: int) -> list[float]:
        frame = process.render(frame_task(task, POSE, f"{seed}", seed=seed), lambda progress: None)
        return [float(half.astype(np.float64).mean()) for half in (frame.a, frame.b)]

    (value, noise), (expected, reference_error) = converged_mean(halves), reference(name)
    difference, error = 100.0 * (value / expected - 1.0), 100.0 * np.hypot(noise, reference_error) / expected
    logging.getLogger(__name__).info("| %s | %s | %+.3f (%.3f) |", name, backend, difference, error)
    # Five standard errors: of Student's t of few values, and of as many cases.
    assert abs(difference) < min(0.1, 5.0 * error)
