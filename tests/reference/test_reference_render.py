"""The reference renderer against what can be known without it: furnaces, quadrature, and light inside a sphere."""

import numpy as np
import pytest
from diffuse_scenes import SIGMAS, dome, estimate, lambert
from shapes import CAMERA, INSIDE, POSE, SIZE, Plane, Sphere

from lookdev.brdf import MODELS, complete_parameters, evaluate_cosine
from lookdev.light import Emission
from lookdev.light.mapping import rotate_z, uv_to_direction
from lookdev.scene import Camera, Pose, camera_rays

NOISE = 2e-2


def assert_agrees(got, expected):
    """Check values within their own noise, which must be small; where there is none, to 1e-9."""
    assert (got.error <= NOISE * got.value).all()
    assert (np.abs(got.value - expected) <= SIGMAS * got.error + 1e-9).all()


@pytest.fixture(scope="module")
def white():
    return dome(np.ones((1, 1, 3)))


@pytest.fixture(scope="module")
def lamps():
    return dome(0.05 + 5.0 * np.random.default_rng(5).uniform(size=(16, 32, 3)) ** 6)


def sky(light, pose, height=64):
    """Return directions (N, 3), radiance from them (N, 3) and solid angles (N, 1): a midpoint rule over the sphere."""
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    direction = uv_to_direction(np.stack([u, v], axis=-1)).reshape(-1, 3)
    solid = 2.0 * (np.pi / (2 * height)) * np.sin(np.pi / (2 * height)) * np.hypot(*direction[:, :2].T)
    solid *= 4.0 * np.pi / solid.sum()
    return rotate_z(direction, pose.lighting - pose.element), light.radiance(np.zeros(3), direction), solid[:, None]


def in_pixel(shape, pixel, pose):
    """Return where nine rays spread over a pixel hit, the frames there, and the rays."""
    x, y = (np.stack(np.meshgrid([1, 3, 5], [1, 3, 5])).reshape(2, -1) / 6.0) + pixel[:, None]
    origin, ray = camera_rays(CAMERA, pose, SIZE, x, y)
    is_hit, point = shape.intersect(origin, ray)
    assert is_hit.all()
    return point, shape.frame(point, -ray)[0], ray


def normals_in_pixels(shape, pose=POSE):
    """Return the normals (P, 9, 3), towards the viewer, where rays hit."""
    return np.stack([in_pixel(shape, pixel, pose)[1][:, 2] for pixel in INSIDE])


def irradiance(normals, light, pose=POSE):
    """Return the mean irradiance (P, 3) of places of the given normals (P, 9, 3)."""
    direction, radiance, solid = sky(light, pose)
    return np.maximum(normals @ direction.T, 0.0).mean(axis=1) @ (radiance * solid)


def mean_irradiance(light):
    """Return the irradiance (3,) of a sphere's outside, averaged over the sphere: a quarter faces each direction."""
    _, radiance, solid = sky(light, POSE)
    return (radiance * solid).sum(axis=0) / 4.0


@pytest.mark.parametrize(("presence", "bounces"), [(0, 4), (0.3, 0), (0.3, 1), (0.3, 4), (0.8, 4), (1, 0), (1, 7)])
def test_a_shell_in_a_furnace_lacks_what_is_still_inside_and_lets_through_where_it_is_absent(presence, bounces, white):
    # Half of what is inside leaves at every wall: without holes, all but 0.5 ** (bounces + 1) in the end.
    got = estimate(lambert(0.5, 0.5, presence), Sphere(), white, bounces=bounces)
    half, absent = 0.5 * presence, 1.0 - presence
    bounced = straight = 0.0  # radiance from inside, of a path that has bounced and of one straight from the camera
    for _ in range(bounces):
        bounced, straight = half + absent + half * bounced, half + half * bounced
    assert_agrees(got, half + half * bounced + absent * straight)


@pytest.mark.parametrize("bounces", [0, 3])
def test_light_inside_a_sphere_is_even(bounces, lamps):
    # What a diffuse wall radiates lights every place of its sphere alike: an integrating sphere.
    reflected, transmitted = 0.3, 0.6
    got = estimate(lambert(reflected, transmitted), Sphere(), lamps, bounces=bounces, samples=256)
    inside = transmitted * mean_irradiance(lamps) * sum(reflected**k for k in range(bounces))
    outside = reflected * irradiance(normals_in_pixels(Sphere()), lamps)
    assert_agrees(got, (outside + transmitted * inside) / np.pi)


def test_light_goes_straight_through_what_is_absent(lamps):
    presence, reflected, transmitted = 0.4, 0.3 * 0.4, 0.6 * 0.4
    got = estimate(lambert(0.3, 0.6, presence), Sphere(), lamps, bounces=1)
    normals = normals_in_pixels(Sphere())
    # A unit sphere about the origin: the far wall's normal is where it is.
    far = np.stack(
        [Sphere().trace_onward(point, ray)[1] for point, _, ray in (in_pixel(Sphere(), p, POSE) for p in INSIDE)]
    )
    # Through the near wall comes what the far one scatters, and the light itself through the gaps of the far one.
    inside = transmitted * mean_irradiance(lamps) + (1.0 - presence) * irradiance(-normals, lamps)
    straight = (1.0 - presence) * transmitted * irradiance(far, lamps)
    expected = (reflected * irradiance(normals, lamps) + transmitted * inside + straight) / np.pi
    assert_agrees(got, expected)


@pytest.mark.parametrize("pose", [POSE, Pose(200.0, 40.0)], ids=["front", "back"])
@pytest.mark.parametrize(("reflected", "transmitted"), [(0.8, 0.0), (0.0, 0.8), (0.3, 0.5)])
def test_a_card_shows_the_light_of_both_sides(reflected, transmitted, pose, lamps):
    got = estimate(lambert(reflected, transmitted), Plane(), lamps, pose=pose, bounces=3)
    normals = normals_in_pixels(Plane(), pose)
    front, back = irradiance(normals, lamps, pose), irradiance(-normals, lamps, pose)
    assert_agrees(got, (reflected * front + transmitted * back) / np.pi)


def test_light_may_differ_from_place_to_place():
    class Glow:
        """Uniform over directions, brighter along x."""

        emission = Emission()

        def radiance(self, points, direction):
            return (2.0 + points[:, :1]) * np.ones(3)

        def pdf(self, points, direction):
            return np.full(len(direction), 0.25 / np.pi)

        def sample(self, points, u):
            return white_sky.sample(points, u)

        def distance(self, points, direction):
            return np.full(len(direction), np.inf)

    white_sky = dome(np.ones((1, 1, 3)))
    got = estimate(lambert(0.5), Sphere(), Glow())
    # The sphere's normals are its places; what turns with the light is where it is bright.
    turned = rotate_z(normals_in_pixels(Sphere()), POSE.element - POSE.lighting)
    assert_agrees(got, 0.5 * (2.0 + turned[..., :1].mean(axis=1)))


def test_pixels_count_by_what_they_cover(white):
    # A white disc of known size: the sphere's silhouette, the camera's axis through its middle.
    camera = Camera(40.0, 0.0, (0.3, 0.0, 0.1), 4.0)
    pixels = np.stack(np.meshgrid(np.arange(6), np.arange(6)), axis=-1).reshape(-1, 2)
    got = estimate(lambert(1.0), Sphere(camera.target, 0.9), white, camera=camera, size=(6, 6), pixels=pixels)
    disc = np.pi * np.tan(np.arcsin(0.9 / camera.distance)) ** 2 / (2.0 * np.tan(np.radians(20.0))) ** 2
    assert (got.value[[0, 5, 30, 35]] == 0.0).all()
    error = np.sqrt((got.error**2).sum(axis=0)) / len(pixels)
    assert (np.abs(got.value.mean(axis=0) - disc) < SIGMAS * error).all()
    assert (error < 1e-3).all()


def test_the_same_seed_gives_the_same_picture_and_another_seed_another(lamps):
    bsdf = lambert(0.5, 0.4)
    first, again, other = (estimate(bsdf, Sphere(), lamps, samples=32, bounces=1, seed=seed) for seed in (3, 3, 4))
    # Sums are rounded by how arrays lie in memory.
    np.testing.assert_allclose(first.value, again.value, rtol=1e-12)
    assert (first.value != other.value).all()


MODEL_CASES = {
    "disney": ({"baseColor": (0.8, 0.3, 0.1), "roughness": 0.5, "anisotropic": 0.7}, Sphere()),
    "pixar": ({"surfaceColor": (0.8, 0.3, 0.1), "roughness": 0.6, "metallic": 0.3}, Sphere()),
    "pixar leaf": ({"surfaceColor": (0.4, 0.8, 0.1), "roughness": 0.7, "clear": 0.5, "back": 0.4, "ior": 1.3}, Plane()),
}


@pytest.mark.parametrize("name", MODEL_CASES)
def test_a_model_is_its_quadrature(name, lamps):
    (parameters, shape), model = MODEL_CASES[name], name.split()[0]
    bsdf = MODELS[model].bsdf(complete_parameters(model, parameters))
    got = estimate(bsdf, shape, lamps, bounces=2, samples=512)
    direction, radiance, solid = sky(lamps, POSE)
    for pixel, value, error in zip(INSIDE, got.value, got.error, strict=True):
        _, frames, rays = in_pixel(shape, pixel, POSE)
        wo = np.einsum("nij,nj->ni", frames, -rays)
        f = [evaluate_cosine(bsdf, w, direction @ frame.T) for frame, w in zip(frames, wo, strict=True)]
        expected = (np.mean(f, axis=0) * radiance * solid).sum(axis=0)
        # Nine points a pixel and the midpoint rule are good to 4e-4.
        assert (np.abs(value - expected) < SIGMAS * error + 1e-3 * expected).all()
        assert (error < NOISE * value).all()
