"""Assets on the ground: closed forms, the float64 reference, and pixels that a catcher must not change."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from agreement import coverage
from failed_pictures import comparison
from frames import render_seeds
from looks import quick_among
from scipy import stats
from stored_references import Arrays, StoredReference

from lookdev.asset import Asset, load_asset
from lookdev.asset.builtin import make_sphere
from lookdev.errors import CodegenError
from lookdev.light import Dome, Light
from lookdev.light.rig import load_rig
from lookdev.material import Layer, Look
from lookdev.material.translate.preview_surface import PREVIEW_SURFACE
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.rendering.catcher import remaining_share
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Film, Pose, Sampling, Scene, camera_rays
from lookdev.scene.ground import GREY_LOOK, GROUND_PATH, Ground, add_ground
from lookdev.shipped import rig_file

pytestmark = pytest.mark.cycles

SIZE = (28, 21)
POSE = Pose(50.0, 20.0)
BLACK = Look("black", (Layer("a", "lambert", {"reflectance": (0.0, 0.0, 0.0)}),))
RED = Look("red", (Layer("a", "disney", {"baseColor": (0.7, 0.2, 0.1), "roughness": 0.4}),))
GLOSSY = Look("glossy", (Layer("a", "disney", {"baseColor": (0.2, 0.3, 0.4), "roughness": 0.25, "specular": 1.0}),))
CAMERA = Camera(40.0, 22.0, (0.0, 0.0, -0.5), 6.0, axis=(0.0, 0.0))


def scene_of(
    lights: list[Light], look: Look, under: Look, *, catcher: bool, asset: Asset | None = None, camera: Camera = CAMERA
) -> Scene:
    # Each part of a frame builds its geometry: of 512 x 256 facets, in half a second.
    asset = asset or make_sphere(96, 48)
    ground = Ground(under, 10.0, -1.0, catcher)
    both, look_of_part = add_ground(asset, {slot.path: look for slot in asset.slots}, ground, (0.0, 0.0))
    catchers = frozenset([GROUND_PATH] if catcher else [])
    return Scene(both, look_of_part, tuple(lights), camera, Film(SIZE), catchers=catchers)


def frames_of(worker: Worker, scene: Scene, count: int, **sampling: int) -> list[WorkerFrame]:
    return render_seeds(worker, scene, range(count), pose=POSE, **sampling)


def ground_pixels(scene: Scene) -> Arrays:
    """Return pixels of the asset and of its ground, without those at the edge of the ground."""
    meshes = MeshScene(scene.asset, scene.looks)
    covered = np.argwhere(coverage(meshes, scene.camera, POSE, SIZE) == 1.0)
    pixels = np.random.default_rng(3).permutation(covered)[:60, ::-1]
    options = {"bounces": 2, "samples": 128, "scrambles": 8}
    estimate = frame_pixels(meshes, scene.lights, scene.camera, POSE, SIZE, pixels, **options)
    return {"pixels": pixels, "value": estimate.value, "error": estimate.error}


def composite_on_ground(frame: WorkerFrame) -> np.ndarray:
    """Composite a frame with a catcher over the ground of its render."""
    transmittance = remaining_share(frame.passes["ground"].astype(float), frame.passes["bare"].astype(float))
    return (frame.a.astype(float) + frame.b) / 2.0 + transmittance[..., None] * frame.passes["bare"]


def assert_pixels_agree(
    pictures: list[np.ndarray], expected: np.ndarray, error: np.ndarray, pixels: np.ndarray
) -> None:
    """Compare pixels (n, 2), row and column, of independent pictures (H, W) with expected values (n,)."""
    values = np.stack([picture[tuple(pixels.T)] for picture in pictures])
    noise = np.sqrt(values.var(axis=0, ddof=1) / len(values) + error**2)
    t = (values.mean(axis=0) - expected) / np.maximum(noise, 1e-6)
    freedom = len(values) - 1
    assert abs(t.mean()) < 4.0 * np.sqrt(freedom / (freedom - 2) / len(pixels))
    # Sidak-corrected to 1e-3 over all pixels; edges are binary variables, whose tails are heavier: a quarter more.
    limit = stats.t.ppf(1.0 - (1.0 - (1.0 - 1e-3) ** (1.0 / len(pixels))) / 2.0, freedom)
    assert np.abs(t).max() < 1.25 * limit


def rig(name: str) -> list[Light]:
    return [light.rescale(1.0, (0.0, 0.0, 0.0)) for light in load_rig(rig_file(name)).lights]


def test_the_shadow_under_a_ball_is_the_form_factor_of_a_sphere(worker: Worker, light_of) -> None:
    """A sphere of radius r that touches the ground takes (r / d)^3 of a uniform dome's light, d from its centre.

    The form factor of a sphere at the cosine r / d to a small plane is (r / d)^2 r / d, as it is wholly above it.
    """
    near = Camera(16.0, 7.0, (0.0, -0.35, -1.0), 5.0, axis=(0.0, 0.0))
    scene = scene_of([light_of("white")], BLACK, GREY_LOOK, catcher=True, camera=near)
    frames = frames_of(worker, scene, 6, samples=32, bounces=0)

    u = (np.arange(8) + 0.5) / 8
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    x, y = columns[..., None, None] + u, rows[..., None, None] + u[:, None]
    origin, ray = camera_rays(near, POSE, SIZE, *np.broadcast_arrays(x, y))
    along = np.einsum("...i,i->...", ray, origin)
    meets_ball = along**2 > origin @ origin - 1.0
    point = origin + ((-1.0 - origin[2]) / ray[..., 2])[..., None] * ray
    radius = np.hypot(point[..., 0], point[..., 1])
    shadow = (radius**2 + 1.0) ** -1.5
    is_seen = (ray[..., 2] < 0.0) & (radius < 9.0)
    # Rays to the ground before the ball's contact pass under its bulge.
    before = np.einsum("...i,...i->...", point - origin, ray) < -along
    ground = (is_seen & (~meets_ball | before)).all(axis=(-2, -1))
    assert ground.sum() > 150
    expected = shadow.mean(axis=(-2, -1))
    pixels = np.argwhere(ground)
    # Next to the contact hardly a ray arrives: the spread of few frames is 0 there, that of independent rays is not.
    rays = len(frames) * 32 * scene_task(scene, Sampling(bounces=0)).shaders[-1].directions[0]
    error = np.sqrt(expected[ground] * (1.0 - expected[ground]) / rays)
    assert_pixels_agree([frame.alpha for frame in frames], expected[ground], error, pixels)

    # Nothing but shadow, and the darker the nearer to the contact.
    mean = np.mean([frame.alpha for frame in frames], axis=0)
    light = np.mean([(frame.a + frame.b) / 2.0 for frame in frames], axis=0)
    assert np.abs(light[ground]).max() < 1e-6
    order = np.argsort(expected[ground])
    binned = [values.mean() for values in np.array_split(mean[ground][order], 8)]
    assert (np.diff(binned) > 0.0).all()
    assert expected[ground].max() > 0.8, "the contact is not seen"
    assert mean[ground].argmax() in np.argsort(expected[ground])[-6:]


GROUNDS = [("slopes", GLOSSY), ("slopes", GREY_LOOK), ("three_point", GLOSSY)]


@pytest.mark.parametrize(("light_name", "under"), quick_among(GROUNDS, [("slopes", GLOSSY)]))
def test_a_frame_over_its_ground_is_that_of_the_reference(
    worker: Worker, light_of: Callable[[str], Dome], light_name: str, under: Look, stored_reference: StoredReference
) -> None:
    lights: list[Light] = [light_of("slopes")] if light_name == "slopes" else rig(light_name)
    scene = scene_of(lights, RED, under, catcher=True)
    frames = frames_of(worker, scene, 6, samples=32, bounces=2)
    pictures = [composite_on_ground(frame) for frame in frames]
    reference = stored_reference("ball on glossy ground", ground_pixels, scene=scene)
    with comparison(np.mean(pictures, axis=0), reference["value"], reference["pixels"]):
        values = [picture.mean(axis=-1) for picture in pictures]
        assert_pixels_agree(
            values, reference["value"].mean(axis=-1), reference["error"].mean(axis=-1), reference["pixels"][:, ::-1]
        )
    # There is a shadow, and light that the ball reflects onto the ground and, if it is glossy, its image.
    mean = np.mean([frame.alpha for frame in frames], axis=0)
    covered = np.mean([frame.passes["bare"].sum(axis=-1) for frame in frames], axis=0) > 0.0
    assert ((mean > 0.2) & covered).any()
    light = np.mean([(frame.a + frame.b) / 2.0 for frame in frames], axis=0)
    assert light.min() > -1e-5
    assert ((light.max(axis=-1) > 0.01) & covered).any()


@pytest.mark.both_pythons
def test_ground_that_the_asset_does_not_touch_is_no_part_of_a_frame(worker: Worker) -> None:
    scene = scene_of(rig("three_point")[:1], RED, GREY_LOOK, catcher=True)
    (frame,) = frames_of(worker, scene, 1, samples=16, bounces=0)
    untouched = frame.alpha == 0.0
    ground = frame.passes["bare"].sum(axis=-1) > 0.0
    # Most of the ground is lit by the whole lamp: it has the same samples with the asset and without.
    assert (untouched & ground).sum() > 0.3 * ground.sum()
    assert (frame.a[untouched] == 0.0).all()
    assert (frame.b[untouched] == 0.0).all()
    assert (frame.passes["ground"][untouched] == frame.passes["bare"][untouched]).all()
    assert ((frame.alpha > 0.5) & ground).any()


def test_ground_is_seen_through_an_asset(worker: Worker, light_of: Callable[[str], Dome]) -> None:
    inputs = {"diffuseColor": (0.7, 0.2, 0.1), "opacity": 0.5, "opacityMode": "presence"}
    half = Look("half", (Layer("a", PREVIEW_SURFACE.name, inputs),))
    card = load_asset(builtin="plane")
    lights: list[Light] = [light_of("slopes")]
    caught = scene_of(lights, half, GREY_LOOK, catcher=True, asset=card)
    plain = scene_of(lights, half, GREY_LOOK, catcher=False, asset=card)
    ours = frames_of(worker, caught, 6, samples=32, bounces=1)
    theirs = frames_of(worker, plain, 6, samples=32, bounces=1)
    pixels = np.random.default_rng(5).permutation(np.argwhere(theirs[0].alpha > 0.0))[:300]
    expected = np.stack([((f.a + f.b) / 2.0).mean(axis=-1)[tuple(pixels.T)] for f in theirs])
    error = np.sqrt(expected.var(axis=0, ddof=1) / len(expected))
    assert_pixels_agree([composite_on_ground(f).mean(axis=-1) for f in ours], expected.mean(axis=0), error, pixels)


@pytest.mark.proof
def test_a_frame_knows_its_error(worker: Worker, light_of: Callable[[str], Dome]) -> None:
    """Over the true ground, the error of a frame is that estimated from its halves."""
    scene = scene_of([light_of("slopes")], RED, GREY_LOOK, catcher=True)
    frames = frames_of(worker, scene, 8, samples=16, bounces=1)
    bare = np.mean([frame.passes["bare"] for frame in frames], axis=0)
    pictures = []
    for frame in frames:
        transmittance = remaining_share(frame.passes["ground"].astype(float), frame.passes["bare"].astype(float))
        pictures.append((frame.a.astype(float) + frame.b) / 2.0 + transmittance[..., None] * bare)
    measured = np.var(pictures, axis=0, ddof=1).mean()
    claimed = np.mean([((frame.a.astype(float) - frame.b) / 2.0) ** 2 for frame in frames])
    assert 0.5 < claimed / measured < 2.0


def test_a_catcher_needs_a_backend_that_has_it(light_of: Callable[[str], Dome]) -> None:
    with pytest.raises(CodegenError, match="'nodes' renders no shadow catcher"):
        scene_task(scene_of([light_of("white")], RED, GREY_LOOK, catcher=True), Sampling(), "nodes")
    task = scene_task(scene_of([light_of("white")], RED, GREY_LOOK, catcher=False), Sampling(), "nodes")
    assert replace(task, device="cpu").channels_by_array == {}
