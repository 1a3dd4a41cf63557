"""The viewport's pictures against direct light with shadows in float64, and the time that they take."""

import logging
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import serve_files
from design_page import CELLS
from light_rigs import RIGS, row_of_three
from looks import LOOKS, quick_among
from viewport_page import STATIC, ViewportPage

from lookdev.arrays import Floats
from lookdev.asset import load_asset
from lookdev.asset.builtin import make_plane, make_sphere
from lookdev.build.scenes import build_scenes
from lookdev.cache import Content
from lookdev.job import load_job
from lookdev.light import LIGHT_KINDS, Emission, Light, Shaping
from lookdev.light.dome.maps import load_dome
from lookdev.light.ies import IesProfile
from lookdev.material import Layer, Look
from lookdev.material.usd import read_look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import Estimate, frame_pixels
from lookdev.scene import Camera, Film, Pose, Scene, camera_rays
from lookdev.studio.viewport import view_scene

ROOT = Path(__file__).parents[3]
log = logging.getLogger(__name__)
POSE = Pose(30.0, 75.0)
# For tests that do not depend on the look: it compiles in half of the time of others, and has little noise.
MATT = (Layer("Layer", "lambert", {"reflectance": (0.7, 0.5, 0.3)}),)
LAMPS = [name for name, kind in LIGHT_KINDS.items() if kind.type.shapes]
MOST = 0.120
"""Largest time from a slider to the first changed frame at 512 x 512, in seconds, in software, on two free cores."""


@pytest.fixture(scope="module")
def page(tab: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewportPage]:
    folder = tmp_path_factory.mktemp("viewport")
    with serve_files(folder, STATIC) as url:
        yield ViewportPage(tab, folder, url)


@dataclass(frozen=True)
class Compared:
    """Pixels of the viewport for several seeds, `found` (S, P, 3), and their reference, `expected`."""

    found: Floats
    expected: Estimate

    @property
    def mean(self) -> Floats:
        return np.asarray(self.found.mean(axis=0))

    @property
    def variance(self) -> Floats:
        """Variance of the difference: that of the mean of independent seeds, plus that of the reference."""
        return np.asarray(self.expected.error**2 + self.found.var(axis=0, ddof=1) / len(self.found))

    @property
    def error(self) -> float:
        """Standard error of the sum over pixels and channels, if the channels of a pixel are fully correlated."""
        return float(np.sqrt((np.sqrt(self.variance).sum(axis=-1) ** 2).sum()))

    def assert_agrees(self) -> None:
        """The sums agree within four standard errors, and squared differences of pixels are below twice the variance.

        Both allow 0.1 % for the rounding to float32, and of images to half floats.
        """
        apart, value, noise = self.mean - self.expected.value, self.expected.value, self.variance.sum()
        assert np.isfinite(self.mean).all()
        assert abs(float(apart.sum())) < 4.0 * self.error + 1e-3 * value.sum(), apart.sum() / value.sum()
        ratio = float((apart**2).sum() / (noise + (1e-3 * value**2).sum() * 1e-3))
        assert ratio < 2.0, ratio


def compare(
    page: ViewportPage, scene: Scene, count: int, pixels: int, *, samples: int, seeds: int = 4, shadows: bool = True
) -> Compared:
    """Compare pixels that the asset covers in part or whole."""
    # The limit of samples holds from the start, so that their number does not depend on the speed of the machine.
    settings = {"element": POSE.element, "lighting": POSE.lighting, "shadows": shadows, "most": count, "seed": 0}
    page.js("viewport.set(given[0])", settings)
    page.show(view_scene(scene))
    films = []
    for seed in range(seeds):
        page.js("viewport.set({seed: given[0]})", seed)
        films.append(page.accumulate(count).astype(np.float64))
    covered = np.argwhere(films[0][..., 3] > 0.0)
    rows = covered[np.random.default_rng(5).choice(len(covered), min(pixels, len(covered)), replace=False)]
    reference = MeshScene(scene.asset, scene.looks, scene.slot_lights, scene.slot_groups, shadows=shadows)
    expected = frame_pixels(
        reference, scene.lights, scene.camera, POSE, scene.film.resolution, rows[:, ::-1].copy(), samples=samples
    )
    return Compared(np.stack([film[rows[:, 0], rows[:, 1], :3] for film in films]), expected)


def dome(**changes: Any) -> Light:
    return replace(LIGHT_KINDS["dome"].example(), **changes)  # type: ignore[type-var]


def make_scene(layers: Sequence[Layer], lights: Sequence[Light], sheet: bool = False) -> Scene:
    asset = make_plane() if sheet else make_sphere(64, 32)
    camera = Camera(30.0, 35.0, (0.1, 0.0, 0.05), 5.9, azimuth=20.0, roll=10.0, axis=(0.3, -0.2), shift=(0.02, -0.03))
    look = Look("look", tuple(layers))
    return Scene(asset, {slot.path: look for slot in asset.slots}, tuple(lights), camera, Film((20, 14)))


@pytest.mark.parametrize(
    "name", ["frosted", *(pytest.param(name, marks=pytest.mark.proof) for name in ("brushed", "coated", "chrome"))]
)
def test_a_dome_lights_every_kind_of_lobe(name: str, page: ViewportPage) -> None:
    compare(page, make_scene(LOOKS[name], [dome()]), 64, 60, samples=64).assert_agrees()


def test_a_surface_is_seen_as_often_as_it_is_present(page: ViewportPage) -> None:
    compare(page, make_scene(LOOKS["net"], [dome()], sheet=True), 64, 60, samples=64).assert_agrees()


@pytest.mark.parametrize(
    ("name", "samples"),
    [("matt", 64), *(pytest.param(name, 128, marks=pytest.mark.proof) for name in ("leaf", "painted"))],
)
def test_a_rig_lights_as_its_lamps_and_domes(name: str, samples: int, page: ViewportPage) -> None:
    """Lamps of all kinds, one of which does not rotate; a tilted, coloured dome, and a uniform one."""
    lamps = [LIGHT_KINDS[kind].example() for kind in LAMPS]
    still = replace(lamps[0], emission=replace(lamps[0].emission, turns=False))  # type: ignore[type-var]
    leaning = dome(axes=((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8)), emission=Emission((0.3, 0.2, 0.1)))
    white = load_dome(builtin="white").dome
    same = replace(white, emission=Emission((0.1, 0.1, 0.2)))
    lights = [leaning, still, *lamps[1:], same]
    compare(page, make_scene(LOOKS.get(name, MATT), lights), samples, 40, samples=64).assert_agrees()


def test_an_ies_profile_shapes_a_lamp_and_leaves_the_others_alone(page: ViewportPage) -> None:
    angles = np.array([[0.0, 0.0, 90.0, 180.0], [0.0, 3.0, 1.0, 0.5], [120.0, 0.5, 4.0, 0.5], [360.0, 3.0, 1.0, 0.5]])
    table = Content.store_written(".npy", lambda file: np.save(file, angles.astype(np.float32)))
    beam = Shaping(120.0, 0.5, 1.0, (0.1, 0.2, 0.3), IesProfile(table, 0.5, 1.5))
    # The rig also has a lamp of another kind, and one of the same kind, both without a profile.
    lamps = [LIGHT_KINDS[kind].example() for kind in ("sphere", "sphere", "rect")]
    shaped = replace(lamps[0], emission=replace(lamps[0].emission, shaping=beam))  # type: ignore[type-var]
    compare(page, make_scene(MATT, [shaped, *lamps[1:], dome()]), 64, 40, samples=64).assert_agrees()


HALF_GLASS = Layer("Layer", "pixar", {"surfaceColor": (0.7, 0.5, 0.1), "roughness": 0.0, "clear": 0.5})
"""It reflects and transmits in single directions, and scatters the rest."""


def monkey(lights: Sequence[Light], look: str = "painted") -> Scene:
    """Return Suzanne, who occludes herself, under lights."""
    layers = {**LOOKS, "matt": MATT, "half glass": (HALF_GLASS,)}[look]
    asset, material = load_asset(builtin="suzanne"), Look("look", tuple(layers))
    return replace(Scene.of_look(asset, material, lights[0], (16, 16)), lights=tuple(lights))


# Four seeds of 64 samples of the painted look were 2.3 times as far off as their noise, of 2.
@pytest.mark.parametrize(
    ("look", "samples"),
    [("half glass", 64), *(pytest.param(look, 128, marks=pytest.mark.proof) for look in ("painted", "glassy"))],
)
def test_shadow_is_switched_while_nothing_compiles(look: str, samples: int, page: ViewportPage) -> None:
    scene = monkey([dome()], look)
    shaded = compare(page, scene, samples, 40, samples=64)
    compiled = page.js("return viewport.programs.compiled")
    unshadowed = compare(page, scene, samples, 40, samples=64, shadows=False)
    assert page.js("return viewport.programs.compiled") == compiled
    shaded.assert_agrees()
    unshadowed.assert_agrees()
    assert unshadowed.mean.sum() - shaded.mean.sum() > 4.0 * math.hypot(unshadowed.error, shaded.error)


QUICK = [("texture, local_dome", "matt"), ("shadow", "matt")]
HEAVY = [(rig, "leaf") for rig in ("texture", "local_dome", "shadow", "local grey", "response")]


@pytest.mark.parametrize(("rigs", "look"), quick_among(QUICK + HEAVY, QUICK))
def test_a_rig_casts_shadow(rigs: str, look: str, page: ViewportPage, tmp_path: Path) -> None:
    lights = [light for rig in rigs.split(", ") for light in RIGS[rig](tmp_path)]
    compare(page, monkey(lights, look), 64, 40, samples=64).assert_agrees()


def test_parts_cast_the_shadow_of_linked_lights(page: ViewportPage) -> None:
    compare(page, row_of_three(16), 64, 40, samples=64).assert_agrees()


def windows(scene: Scene, count: int, width: int, side: int) -> Iterator[Scene]:
    """Yield scenes of square crops, `side` pixels of a frame `width` pixels wide, around points of the asset."""
    camera, (across, along) = scene.camera, scene.film.resolution
    x, y = np.random.default_rng(8).uniform((0, 0), (across, along), (400, 2)).T
    origin, ray = camera_rays(camera, POSE, (across, along), x, y)
    hit, _ = MeshScene(scene.asset, scene.looks).intersect(origin, ray)
    share = side / width
    fov = math.degrees(2.0 * math.atan(share * camera.half_width))
    for k in np.flatnonzero(hit)[:count]:
        shift = (x[k] / across - 0.5) / share, (0.5 - y[k] / along) * along / across / share
        yield replace(scene, camera=replace(camera, fov=fov, shift=shift), film=Film((side, side)))


def shipped_scene(asset: str, look: str) -> Scene:
    """Return a scene of a built-in asset and a shipped look."""
    material = read_look(ROOT / "materials" / f"{look}.usda")
    return Scene.of_look(load_asset(builtin=asset), material, load_dome(builtin="courtyard").dome, (512, 512))


@pytest.mark.proof
@pytest.mark.parametrize(("asset", "look"), CELLS)
def test_the_mean_difference_is_one_percent(asset: str, look: str, page: ViewportPage) -> None:
    """The difference of pixels of crops, relative to their values, or to 1 % of the mean for darker ones, is small.

    docs/designer.md has the table, by ``pytest -m proof tests/studio/viewport --log-cli-level=INFO``.
    """
    if asset == "parts":
        scene = build_scenes(load_job(ROOT / "jobs" / "parts.toml")).scenes[look, "courtyard"]
    else:
        scene = shipped_scene(asset, look)
    compared = [compare(page, window, 8192, 16, samples=4096, seeds=2) for window in windows(scene, 3, 64, 8)]
    value = np.concatenate([window.expected.value for window in compared])
    apart = np.concatenate([window.mean for window in compared]) - value
    variance = np.concatenate([window.variance for window in compared])
    floor = np.maximum(value, 0.01 * value.mean())
    difference, noise = (np.abs(apart) / floor).mean(), (np.sqrt(variance) / floor).mean()
    signed = apart.sum() / value.sum()
    error = math.hypot(*(window.error for window in compared)) / value.sum()
    log.info("%s %s: %.4f, noise %.4f, signed %+.4f +- %.4f", asset, look, difference, noise, signed, error)
    assert difference < 0.01


@pytest.mark.bench
@pytest.mark.parametrize(("asset", "look"), [("shaderball", "car_paint"), ("sphere", "brushed_metal")])
def test_a_slider_shows_in_time(asset: str, look: str, page: ViewportPage) -> None:
    """``pytest -m bench tests/studio/viewport --log-cli-level=INFO``."""
    page.show(view_scene(shipped_scene(asset, look)))
    times, scale = page.js(
        "const name = 'layer0_metallic', times = [];"
        "for (let k = 0; k < 40; k++) {"
        "  await pause(150);"
        "  const started = performance.now();"
        "  viewport.setNumbers(0, {[name]: [0.2 + 0.02 * k]});"
        "  await viewport.waitForPicture();"
        "  times.push((performance.now() - started) / 1000);"
        "}"
        "return [times, viewport.scale]"
    )
    median, (load, *_) = float(np.median(times[10:])), os.getloadavg()  # the first ones find the scale that is in time
    log.info("%s %s: median %.3f s, scale %d, load %.1f", asset, look, median, 2**scale, load)
    assert median <= MOST
